"""Nonlinear model predictive control with CasADi and IPOPT: what could be had at any price, as an upper bound.

Its model is the design model of a plant with a steady plunger [5.4], whose duty lags, with the polynomial map [5.10],
which is smooth; at every sample that map is shifted to the flow that the observer's own map has there.
"""

import dataclasses
import functools
import math
from typing import Any, cast

import casadi as ca
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from vgtjax.control import AbstractController, LevantDifferentiator, LoadObserver, Measurement, Reference, saturate
from vgtjax.parts import FULL_DUTY, PolynomialFlow
from vgtjax.plants import fit_flow_map

from .solves import Solves

NODES, STEP = 15, 6e-3
"""Of the horizon, and s from one to the next."""
TRACKING, CHATTER = 1e-5, 4.0
"""m, and % from one node to the next, that count as one."""
SHARE = 0.4
"""Of the load, that is held to be an error of the flow map, as in [`LoadBackstepping`][]."""
MODEL = ("area", "preload", "stiffness", "damping", "mass", "air", "volume", "lag", "a0", "a1", "a2", "b1", "b2")
GIVEN = ("position", "velocity", "pressure", "duty", "load", "ambient", "flow", "before")
WANTED = ("position", "velocity", "acceleration", "jerk")
"""What the solver is told: of the model, of the sample, and of the reference, which it extends by its derivatives."""
SOLVES = Solves()
"""Of all controllers of this process, since it was last looked at."""


class NonlinearMPC(AbstractController):
    """IPOPT at every sample, on what a [`LoadObserver`][] makes of the position."""

    observer: LoadObserver
    smooth: PolynomialFlow
    differentiator: LevantDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(1.0, width=2e-3))

    @classmethod
    def for_plant(cls, plant: Any, **settings: Any) -> "NonlinearMPC":
        """On the design model of the plant."""
        fitted = cast(PolynomialFlow, fit_flow_map(plant, "polynomial").flow_map)
        # One range for all plants, so that their controllers are of one structure.
        smooth = dataclasses.replace(fitted, pressure_range=PolynomialFlow().pressure_range)
        return cls(LoadObserver.for_plant(plant), smooth, **settings)

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return frozenset({"pressure"})

    def initial_state(self, measurement: Measurement) -> Any:
        """As a controller that learns the load begins."""
        estimate = self.observer.initial_state(measurement.position, measurement.ambient)
        memory = self.differentiator.initial_state(measurement.position)
        return estimate, memory, jnp.zeros_like(measurement.position), jnp.zeros(NODES)

    def update(self, state: Any, measurement: Measurement, reference: Reference, period: float) -> Any:
        """See the base class; uses position and atmosphere alone."""
        estimate, memory, before, guess = state
        position, ambient, observer = measurement.position, measurement.ambient, self.observer
        memory, slow = self.differentiator.update(memory, position, period, reference.velocity)
        estimate = observer.step(estimate, position, slow, ambient, before, period)
        load = estimate.load + observer.friction(estimate, jnp.zeros_like(position))
        x, v, p = estimate.position, estimate.velocity, estimate.pressure
        flow = observer.model.flow_map(estimate.duty, p, ambient) - self.smooth(estimate.duty, p, ambient)
        given = jnp.stack([x, v, p, estimate.duty, load, ambient, flow, before])
        wanted = jnp.stack([getattr(reference, name) for name in WANTED])
        shape = jax.ShapeDtypeStruct((NODES,), guess.dtype)
        problem = jnp.concatenate([given, wanted, self._model()])
        guess = jax.pure_callback(_solve, shape, problem, guess, vmap_method="sequential")
        duty = guess[0]
        log = {"pressure": observer.observed_pressure(estimate, jnp.asarray(SHARE)), "load": estimate.load}
        return (estimate, memory, saturate(duty), guess), duty, log

    def _model(self) -> Float[jax.Array, " numbers"]:
        """In the order of `MODEL`."""
        model, smooth = self.observer.model, self.smooth
        body, friction = model.diaphragm, model.friction
        air = model.exponent * model.air.gas_constant * model.air.temperature
        damping = body.damping + friction.viscous_damping
        rod = (body.area, body.preload, body.stiffness, damping, body.mass, air, model.chamber.volume)
        return jnp.stack([*map(jnp.asarray, (*rod, self.observer.plunger_time, *smooth.pressure, *smooth.duty))])


@functools.cache
def _solver() -> ca.Function:
    """IPOPT over the duties of the horizon; implicit steps of Euler, linear but for the flow."""
    names = (*GIVEN, *(f"wanted {name}" for name in WANTED), *MODEL)
    numbers, duties = ca.MX.sym("numbers", len(names)), ca.MX.sym("duties", NODES)
    at = dict(zip(names, ca.vertsplit(numbers), strict=True))
    x, v, p, lagged, last = (at[name] for name in ("position", "velocity", "pressure", "duty", "before"))
    cost: Any = 0
    for node in range(NODES):
        duty, when = duties[node], (node + 1) * STEP
        x, v, p, lagged = _onward(at, x, v, p, lagged, duty)
        wanted = sum(at[f"wanted {name}"] * when**k / math.factorial(k) for k, name in enumerate(WANTED))
        cost += ((x - wanted) / TRACKING) ** 2 + ((duty - last) / CHATTER) ** 2
        last = duty
    problem: Any = {"x": duties, "p": numbers, "f": cost / NODES}
    quiet: dict[str, Any] = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.max_iter": 30}
    warm: dict[str, Any] = {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-3, "ipopt.tol": 1e-4}
    return ca.nlpsol("mpc", "ipopt", problem, quiet | warm | {"error_on_fail": False, "expand": True})


def _onward(at: dict[str, ca.MX], x: ca.MX, v: ca.MX, p: ca.MX, lagged: ca.MX, duty: ca.MX) -> tuple[ca.MX, ...]:
    """One step; the flow and its slope are those of where it begins."""
    h, lag = STEP, at["lag"]
    lagged = (lag * lagged + h * duty) / (lag + h)
    flow = at["flow"] + at["a0"] + at["a1"] * p + at["a2"] * p**2 + at["b1"] * lagged + at["b2"] * lagged**2
    volume = at["volume"] - at["area"] * x
    slope = at["air"] / volume * (at["a1"] + 2 * at["a2"] * p)
    swept = at["area"] * p / volume
    # p' = rate + slope (p' - p) h + swept v', v' from the rod with both at the end of the step.
    held, gain = p + h * at["air"] / volume * flow / (1 - h * slope), h * swept / (1 - h * slope)
    force = (at["ambient"] - held) * at["area"] - at["preload"] - at["stiffness"] * x - at["load"]
    inertia = at["mass"] + h * at["damping"] + h**2 * at["stiffness"] + h * at["area"] * gain
    v = (at["mass"] * v + h * force) / inertia
    return x + h * v, v, held + gain * v, lagged


def _solve(problem: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """The duties that IPOPT ends with, converged or not, which is noted."""
    found = _solver()(x0=np.asarray(guess), p=np.asarray(problem), lbx=0.0, ubx=FULL_DUTY)["x"]
    SOLVES.note(_solver().stats())
    return np.asarray(found, guess.dtype).ravel()
