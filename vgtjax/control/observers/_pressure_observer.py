"""Chamber pressure and friction from the position alone: the sliding mode observer [5.11-5.21]."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..._errors import InputError
from ..._types import Scalar
from ...parameters import parameter
from ...parts import FULL_DUTY, AbstractFlowMap
from ...plants import AbstractPlant
from .._design import AbstractDesign, Condition, positive
from .._design_model import DesignModel, Motion

DUTIES = 21
"""Duties at which the slope of a flow map is looked at; it is smooth in between."""
PRESSURES = 41
"""Pressures, from a tenth of the atmosphere to all of it."""
SPEEDS = 101
"""Speeds at which stability is checked."""
HALVINGS = 8
"""Of the friction rate at most, until [5.21] holds for a plant."""


class ObservedState(eqx.Module):
    """Velocity in m/s, deflection of the bristles in m, chamber pressure in Pa absolute, and the vanes' state."""

    velocity: Scalar
    deflection: Scalar
    pressure: Scalar
    vanes: PyTree[Scalar] = None


class PressureObserver(AbstractDesign):
    """Velocity, bristles and chamber pressure from position and velocity [5.11-5.21], with its signs corrected.

    A copy of the [`DesignModel`][] that is corrected by the error of its velocity alone: `injection_rate > 0` alone is
    the smooth version, `switching_gain > 0` alone the switching one. The manual's page of derivations derives the
    conditions of stability and says how to choose the gains.

    **Raises:** `InputError` for gains or a flow map that break a condition, or without any correction.
    """

    model: DesignModel = eqx.field(default_factory=DesignModel)
    friction_rate: Scalar = parameter(5.0, symbol="a", unit="1/s", source="5.12, value assumed")
    pressure_rate: Scalar = parameter(50.0, symbol="b", unit="1/s", source="5.12, value assumed")
    injection_rate: Scalar = parameter(1400.0, symbol="alpha_2", unit="1/s", source="5.12, value assumed", lower=0.0)
    switching_gain: Scalar = parameter(0.0, symbol="K_2", unit="m/s2", source="5.12, value assumed", lower=0.0)
    largest_velocity: Scalar = parameter(0.1, symbol="v_max", unit="m/s", source="5.21, value assumed", held=True)
    """Of the rod, up to which the conditions are checked; nothing else uses it."""
    largest_pressure_error: Scalar = parameter(0.0, symbol="e4_max", unit="Pa", source="5.16", lower=0.0, held=True)
    largest_deflection_error: Scalar = parameter(0.0, symbol="e3_max", unit="m", source="5.16", lower=0.0, held=True)
    """With errors up to these two the observer has to slide; zero, as by default, asks for nothing. Nothing else uses
    them."""

    @classmethod
    def for_plant(cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any) -> "PressureObserver":
        """On the plant's [`DesignModel`][] or another one, with the friction rate halved until [5.21] holds for it."""
        model = DesignModel.for_plant(plant) if model is None else model
        rate = cls.friction_rate
        for _ in range(HALVINGS):
            try:
                return cls(**{"model": model, "friction_rate": rate} | settings)
            except InputError:
                rate = rate / 2
        return cls(**{"model": model, "friction_rate": rate} | settings)

    def conditions(self) -> dict[str, Condition]:
        """[5.20, 5.21] corrected, the determinant as a part of `a sigma_0 / sigma_1`."""
        friction, correction = self.model.friction, self.injection_rate + self.switching_gain
        bound, (margin, growth) = jnp.min(self.largest_friction_rate()), self.stability_margin()
        sliding = self.least_switching_gain()
        return positive(self, "friction_rate", "pressure_rate") | {
            "corrected at all": Condition(
                correction,
                "injection_rate plus switching_gain must be positive, or nothing is corrected",
                correction,
                "use e.g. injection_rate=1000",
                bounds_gains=False,
            ),
            "friction_rate below its bound [5.21]": Condition(
                1 - self.friction_rate / bound,
                "friction_rate must be at most 4 sigma_0 F_c / (theta sigma_1^2 v_max) = {limit:.4g} 1/s",
                self.friction_rate,
                "lower it or largest_velocity",
                bound,
                closed=True,
            ),
            "switching_gain above its bound [5.16]": Condition(
                jnp.where(sliding > 0, self.switching_gain / jnp.where(sliding > 0, sliding, 1.0) - 1, 1.0),
                "switching_gain must exceed (A_d e4 + theta |S| e3) / m = {limit:.4g} m/s2 at the largest errors for "
                "sliding [5.16]",
                self.switching_gain,
                "raise it, or lower largest_pressure_error",
                sliding,
                asked=sliding > 0,
            ),
            "pressure_rate above its bound [5.21]": Condition(
                jnp.min(margin) / (self.friction_rate * friction.bristle_stiffness / friction.bristle_damping),
                "pressure_rate b must outweigh the growth F of pressure errors at every velocity up to "
                "largest_velocity for [5.21], F being up to {limit:.3g} 1/s",
                self.pressure_rate,
                "raise pressure_rate, or lower friction_rate or largest_velocity",
                jnp.max(growth),
            ),
        }

    def least_switching_gain(self, pressure_error: Scalar | None = None) -> Array:
        """The bound of `K_2` in m/s2: by how much the largest errors accelerate the rod at most, at speeds checked.

        **Arguments:** `pressure_error` in Pa, `largest_pressure_error` if it is not given.
        """
        model, wrong = self.model, self.largest_pressure_error if pressure_error is None else pressure_error
        ends = jnp.stack([jnp.zeros_like(self.largest_velocity), self.largest_velocity])
        stiffest = jnp.max(jnp.abs(jax.vmap(model.stiffness)(ends)))
        elastic = model.load * stiffest * self.largest_deflection_error
        return (model.diaphragm.area * wrong + elastic) / model.diaphragm.mass

    def largest_friction_rate(self) -> Array:
        """The bound of `a` in 1/s."""
        friction = self.model.friction
        steady = jnp.minimum(friction.coulomb_force, friction.static_force)
        steepness = self.model.load * friction.bristle_damping**2 * self.largest_velocity
        return 4 * friction.bristle_stiffness * steady / steepness

    def stability_margin(self) -> tuple[Float[Array, " velocities"], Float[Array, " velocities"]]:
        """How far `V_O'` is from rising, in 1/s2, and `F` in 1/s, at speeds up to the largest one.

        The lesser of `b - F` (times `c`) and of the two sides of the determinant's condition above.
        """
        return _stability_margin(self)

    def lyapunov(self, deflection_error: Array, pressure_error: Array) -> Array:
        """`V_O` in N2, of errors in m and Pa of one shape."""
        elastic = self.model.friction.bristle_stiffness * deflection_error
        pneumatic = self.model.diaphragm.area * pressure_error
        share = self.friction_rate / (self.pressure_rate * self.model.load)
        return 0.5 * (elastic**2 + share * pneumatic**2)

    def initial_state(self, pressure: Scalar) -> ObservedState:
        """At rest with relaxed bristles, at a pressure in Pa absolute."""
        nothing = jnp.zeros_like(pressure)
        return ObservedState(nothing, nothing, pressure, self.model.vane_force.initial_state())

    def step(self, state: ObservedState, motion: Motion, duty: Scalar, period: float) -> tuple[ObservedState, Scalar]:
        """One step of implicit Euler, its sign included, to the sample at which position and velocity are known.

        **Arguments:** `motion` at the sample; `duty` in percent, held since the last one; `period` in s.

        **Returns:** the state at the sample, and the rate `zh'` in m/s there.
        """
        model, body, velocity = self.model, self.model.diaphragm, motion.velocity
        share = model.off_stops(motion.position)
        by_deflection = share * self.friction_rate * body.mass / model.friction.bristle_stiffness
        by_pressure = share * self.pressure_rate * body.mass / body.area
        # Every unknown is a constant plus a factor times the correction w.
        law, nothing = model.friction, jnp.zeros_like(velocity)
        deflection = Affine(
            law.deflection_after(state.deflection, velocity, velocity, period),
            law.deflection_after(nothing, -by_deflection, velocity, period),
        )
        pressure = self._pressure(state.pressure, motion, duty, period, by_pressure)
        vanes = model.vane_state_after(motion, state.vanes, period)
        friction = model.load * model.stiffness(velocity)
        resistance = friction * deflection.constant + model.vane_load(motion, vanes)[0]
        push = model.acceleration(motion.position, nothing, resistance, pressure.constant, motion.ambient)
        lag = 1 + period * model.damping / body.mass
        by_w = 1 - (body.area * pressure.factor + friction * deflection.factor) / body.mass
        speed = Affine((state.velocity + period * push) / lag, period * by_w / lag)
        w = self._correction(velocity - speed.constant, speed.factor)
        found = ObservedState(speed(w), deflection(w), pressure(w), vanes)
        return found, model.deflection_rate(velocity, found.deflection) - by_deflection * w

    def _pressure(self, pressure: Scalar, motion: Motion, duty: Scalar, period: float, by_pressure: Scalar) -> "Affine":
        at = (duty, motion.position, motion.velocity, pressure, motion.ambient)
        growth = 1 - period * self.model.map_rate_slope(*at)
        return Affine(pressure + period * self.model.map_rate(*at) / growth, -period * by_pressure / growth)

    def _correction(self, missing: Scalar, by_w: Scalar) -> Scalar:
        """`w` in m/s2, from `e2 = missing - by_w w`."""
        switching = jnp.clip(missing / by_w, -self.switching_gain, self.switching_gain)
        return (self.injection_rate * missing + switching) / (1 + self.injection_rate * by_w)


class Affine(eqx.Module):
    """`constant + factor w`."""

    constant: Scalar
    factor: Scalar

    def __call__(self, w: Scalar) -> Scalar:
        """The value at `w`."""
        return self.constant + self.factor * w


# Compiled: as plain operations each would be compiled by itself.
@eqx.filter_jit
def _stability_margin(observer: PressureObserver) -> tuple[Array, Array]:
    model, body = observer.model, observer.model.diaphragm
    a, b, load = observer.friction_rate, observer.pressure_rate, model.load
    speed = jnp.linspace(0.0, 1.0, SPEEDS) * observer.largest_velocity
    travel = jnp.where(jnp.isfinite(body.travel), body.travel, 0.0)
    slopes = model.gas_energy * _largest_slope(model.flow_map) + body.area * speed
    growth = model.exponent * slopes / model.volume(travel)
    steep = model.friction.bristle_stiffness / model.friction.bristle_damping
    lost = jax.vmap(model.relaxation_rate)(speed) / steep
    rest = b - growth
    determinant = rest * (steep * lost + a * load * (1 - lost)) - 0.25 * a * b * load * (2 - lost) ** 2
    return jnp.minimum(determinant, rest * steep), growth


def _largest_slope(flow_map: AbstractFlowMap) -> Float[Array, ""]:
    """Largest `df/dp` in kg/(s Pa) on a grid, where the map is valid."""
    duties, shares = jnp.linspace(0.0, FULL_DUTY, DUTIES), jnp.linspace(0.1, 1.0, PRESSURES)
    duty, share = jnp.meshgrid(duties, shares)
    pressure = share * flow_map.ambient
    slope = jax.jvp(lambda at: flow_map(duty, at), (pressure,), (jnp.ones_like(pressure),))[1]
    return jnp.max(jnp.where(flow_map.valid(duty, pressure), slope, -jnp.inf))
