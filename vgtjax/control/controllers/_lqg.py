"""Linear quadratic Gaussian control on the reduced model, linear about the middle of its travel."""

import math
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from ..._errors import InputError
from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Reference, saturate
from .._design_model import DesignModel
from ..surroundings import POSITION_NOISE

PERIOD = 1e-3
"""s between samples, where no other is asked for."""
WEIGHTS = (1e-4, 0.02, 5e3)
"""m, m/s and Pa that are worth as much as `DUTY_WEIGHT`."""
DUTY_WEIGHT = 10.0
"""%"""
DUTY_SPAN, PRESSURE_SPAN = 10.0, 1e4
"""% and Pa to either side, over which the flow is taken for linear."""
PROCESS_NOISE = (1e-7, 1e-3, 30.0, 0.3)
"""Standard deviations of what a millisecond adds to position in m, velocity in m/s, pressure in Pa and load in N."""


class LQGState(eqx.Module):
    """Deviations from the middle in m, m/s and Pa, the load in N, and the duty less that of the middle in percent."""

    estimate: Float[Array, " 4"]
    duty: Scalar


class LinearModel(eqx.Module):
    """The design model one sample on, linear about where it rests: `y_next = transition y + input u`.

    `y` is position, velocity, pressure and a load that stays as it is; `position`, `pressure` and `duty` are where it
    rests. `settle` says which pressure and duty hold it under a load, at a position, a velocity and an acceleration.
    """

    transition: Float[Array, "4 4"]
    input: Float[Array, " 4"]
    position: Scalar
    pressure: Scalar
    duty: Scalar
    stiffness: Scalar
    damping: Scalar
    mass: Scalar
    area: Scalar
    inflow: Float[Array, " 3"]
    """Slopes of the pressure's rate with respect to velocity, pressure and duty."""
    period: float = eqx.field(static=True)
    """s between its samples."""

    def target(self, reference: Reference, load: Scalar) -> tuple[Float[Array, " 4"], Scalar]:
        """Deviations of the state and of the duty in percent that follow a reference under a load in N."""
        position = reference.position - self.position
        along = self.stiffness * reference.velocity + self.damping * reference.acceleration
        force = (
            self.stiffness * position + self.damping * reference.velocity + self.mass * reference.acceleration + load
        )
        pressure, rate = -force / self.area, -(along + self.mass * reference.jerk) / self.area
        by_velocity, by_pressure, by_duty = self.inflow
        duty = (rate - by_velocity * reference.velocity - by_pressure * pressure) / by_duty
        return jnp.stack([position, reference.velocity, pressure, load]), duty


class LQG(AbstractController):
    """A Kalman filter on position alone, and a linear quadratic regulator about the reference.

    Dry friction and gas are one load that the filter observes. `for_plant` designs both by the discrete Riccati
    equation; afterwards their gains are gains like others, that can be tuned. The chamber pressure is observed.
    """

    sampled: ClassVar[bool] = True
    feedback: Float[Array, " 3"] = parameter(
        (0.0, 0.0, 0.0), symbol="K", unit=("%/m", "% s/m", "%/Pa"), source="assumed", positive=False
    )
    """On position, velocity and pressure."""
    correction: Float[Array, " 4"] = parameter(
        (0.0, 0.0, 0.0, 0.0), symbol="L", unit=("1", "1/s", "Pa/m", "N/m"), source="assumed", positive=False
    )
    """Of the filter's state by the error of its position."""
    model: LinearModel = eqx.field(kw_only=True)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, *, period: float = PERIOD, **settings: Any) -> "LQG":
        """Designed for the plant's [`DesignModel`][], for samples of `period` s and noise of an assumed sensor."""
        model = linearise(DesignModel.for_plant(plant), period)
        feedback, correction = design(model)
        return cls(**{"feedback": feedback, "correction": correction, "model": model} | settings)

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return frozenset({"pressure"})

    def initial_state(self, measurement: Measurement) -> LQGState:
        """At rest where it is measured, with the chamber at the pressure that holds it there."""
        none = jnp.zeros_like(measurement.position)
        here = Reference(measurement.position, none, none, none)
        return LQGState(*self.model.target(here, none))

    def update(
        self, state: LQGState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[LQGState, Scalar, Log]:
        """See the base class; logs `velocity` in m/s, the observed `pressure` in Pa absolute and the `load` in N.

        **Raises:** `InputError` for another period than that of its design.
        """
        model = self.model
        if not math.isclose(period, model.period):
            raise InputError(
                f"this LQG is designed for samples every {1e3 * model.period:g} ms, but the loop has them every "
                f"{1e3 * period:g} ms; use LQG.for_plant(plant, period={period:g})"
            )
        expected = model.transition @ state.estimate + model.input * state.duty
        estimate = expected + self.correction * (measurement.position - model.position - expected[0])
        wanted, duty = model.target(reference, estimate[3])
        command = model.duty + duty - self.feedback @ (estimate - wanted)[:3]
        log = {"velocity": estimate[1], "pressure": model.pressure + estimate[2], "load": estimate[3]}
        return LQGState(estimate, saturate(command) - model.duty), command, log


def linearise(model: DesignModel, period: float) -> LinearModel:
    """A design model about the middle of its travel, sliding: its dry friction is a load. One sample is `period` s."""
    body, ambient, damping = model.diaphragm, model.air.pressure, model.sliding_damping
    position = body.middle
    pressure = body.balance_pressure(ambient, position)
    duty = model.flow_map.duty_for(jnp.zeros_like(pressure), pressure, ambient)

    # Slopes at rest are those of a plunger between its seats, and hold for a hundredth of the duty that control uses.
    def flow(pressure: Scalar, duty: Scalar) -> Scalar:
        return model.map_rate(duty, position, jnp.zeros_like(duty), pressure, ambient)

    by_pressure = (flow(pressure + PRESSURE_SPAN, duty) - flow(pressure - PRESSURE_SPAN, duty)) / (2 * PRESSURE_SPAN)
    by_duty = (flow(pressure, duty + DUTY_SPAN) - flow(pressure, duty - DUTY_SPAN)) / (2 * DUTY_SPAN)
    by_velocity = model.exponent * body.area * pressure / model.volume(position)
    inflow = jnp.stack([by_velocity, by_pressure, by_duty])
    continuous = np.zeros((5, 5))
    continuous[0, 1] = 1.0
    continuous[1, :4] = -np.array([body.stiffness, damping, body.area, 1.0]) / float(body.mass)
    continuous[2, 1:3], continuous[2, 4] = inflow[:2], inflow[2]
    onward = scipy.linalg.expm(continuous * period)
    return LinearModel(
        transition=jnp.asarray(onward[:4, :4]),
        input=jnp.asarray(onward[:4, 4]),
        position=position,
        pressure=pressure,
        duty=duty,
        stiffness=body.stiffness,
        damping=damping,
        mass=body.mass,
        area=body.area,
        inflow=inflow,
        period=period,
    )


def design(model: LinearModel) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 4"]]:
    """Gains of the regulator and of the filter, by the discrete Riccati equation."""
    transition, push = np.asarray(model.transition), np.asarray(model.input)
    inner, input_ = transition[:3, :3], push[:3, None]
    cost = scipy.linalg.solve_discrete_are(inner, input_, np.diag(1 / np.square(WEIGHTS)), [[DUTY_WEIGHT**-2]])
    feedback = np.linalg.solve(DUTY_WEIGHT**-2 + input_.T @ cost @ input_, input_.T @ cost @ inner)[0]
    seen, noise = np.eye(4)[:, :1], np.diag(np.square(PROCESS_NOISE)) * model.period / PERIOD
    spread = scipy.linalg.solve_discrete_are(transition.T, seen, noise, [[POSITION_NOISE**2]])
    return feedback, spread[:, 0] / (spread[0, 0] + POSITION_NOISE**2)
