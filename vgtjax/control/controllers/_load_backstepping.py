"""Adaptive backstepping from the position alone, for plants that it does not know."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference, room, saturate
from .._design import Condition, positive
from .._design_model import DesignModel, lighter
from ..observers import AbstractDifferentiator, LevantDifferentiator, LoadEstimate, LoadObserver

NEAR_LIMIT = 5.0
"""%; the duty's distance from a limit within which the rod counts as following the reference the less."""


class LoadState(eqx.Module):
    """What was estimated at the last sample, what the differentiator remembers, and the duty since then in percent."""

    estimate: LoadEstimate
    differentiator: Memory
    duty: Scalar
    lag: Scalar
    """m/s; of the reference's velocity, what the rod did not take part in."""


class Wanted(eqx.Module):
    """The motion that would bring the error to zero, and the pressure for it."""

    velocity: Scalar
    """m/s"""
    acceleration: Scalar
    """m/s2"""
    jerk: Scalar
    """m/s3"""
    pressure: Scalar
    """`p*` in Pa absolute, in the flow map's terms."""


class LoadBackstepping(AbstractController):
    """Backstepping on what a [`LoadObserver`][] makes of the position: velocity, pressure, load and friction level.

    With `e = x - x_ref` and the wanted velocity `x_ref' - lambda e`, the error of the velocity `s1` is driven by the
    pressure, whose wanted value has the learned load in it and so leaves no constant error. Only the rate of `p*`
    along the wanted motion is asked of the flow map, so that nothing fast gets into the duty. The manual's page on
    control has the law, the proof, and what it holds on plants that it does not know.

    **Raises:** `InputError` for gains with which errors do not die away.
    """

    position_gain: Scalar = parameter(50.0, symbol="lambda", unit="1/s", source="5.22, value assumed")
    velocity_gain: Scalar = parameter(300.0, symbol="K_d", unit="1/s", source="5.34, value assumed", lower=0.0)
    pressure_gain: Scalar = parameter(60.0, symbol="K_U", unit="1/s", source="5.34, value assumed")
    flow_share: Scalar = parameter(0.4, symbol="kappa", unit="1", source="assumed", lower=0.0, held=True)
    """Of the load, that the flow map's errors are held to be; of no effect on the duty."""
    observer: LoadObserver = eqx.field(default_factory=LoadObserver)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(1.0, width=2e-3))

    @classmethod
    def for_plant(cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any) -> "LoadBackstepping":
        """On the plant's [`DesignModel`][] or another one; `K_d` in inverse proportion to its mass."""
        model = DesignModel.for_plant(plant) if model is None else model
        scaled = {"velocity_gain": lighter(model) * cls.velocity_gain}
        return cls(**{"observer": LoadObserver.for_plant(plant, model)} | scaled | settings)

    def conditions(self) -> dict[str, Condition]:
        """Errors of the velocity are those of a mass with spring and damper; their damping is positive."""
        model = self.observer.model
        bound = self.position_gain - model.sliding_damping / model.diaphragm.mass
        return positive(self, "position_gain", "pressure_gain") | {
            "pressure_gain above its bound": Condition(
                (self.pressure_gain - bound) / self.position_gain,
                "pressure_gain K_U must exceed lambda - b/m = {limit:.4g} 1/s, or the error of the velocity swings",
                self.pressure_gain,
                "raise it, or lower position_gain",
                bound,
            )
        }

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return frozenset({"pressure"})

    def initial_state(self, measurement: Measurement) -> LoadState:
        """At rest, with the chamber at atmosphere."""
        estimate = self.observer.initial_state(measurement.position, measurement.ambient)
        memory = self.differentiator.initial_state(measurement.position)
        nothing = jnp.zeros_like(measurement.position)
        return LoadState(estimate, memory, nothing, nothing)

    def update(
        self, state: LoadState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[LoadState, Scalar, Log]:
        """See the base class; uses position and atmosphere alone.

        Logs `velocity` in m/s, the observed `pressure` in Pa absolute, `friction` and `load` in N, the friction
        `level`, the `pressure_deviation` in Pa, and the `wanted_pressure` in Pa absolute of the flow map.
        """
        # This velocity only drives the bristles, whose force is bounded: an error that stays for a while does no harm.
        follows = room(state.duty, NEAR_LIMIT) * self.observer.free(state.estimate)
        lag = _velocity_lag(state.lag, follows, reference, period)
        position, ambient = measurement.position, measurement.ambient
        memory, slow = self.differentiator.update(state.differentiator, position, period, reference.velocity - lag)
        estimate = self.observer.step(state.estimate, position, slow, ambient, state.duty, period)
        wanted = self.wanted(estimate, reference, ambient)
        duty = self._duty(estimate, wanted, ambient)
        log = {
            "velocity": estimate.velocity,
            "pressure": self.observer.observed_pressure(estimate, self.flow_share),
            "friction": self.observer.friction(estimate, estimate.velocity),
            "load": estimate.load,
            "level": estimate.level,
            "pressure_deviation": estimate.pressure_deviation,
            "wanted_pressure": wanted.pressure,
        }
        return LoadState(estimate, memory, saturate(duty), lag), duty, log

    def wanted(self, estimate: LoadEstimate, reference: Reference, ambient: Scalar) -> Wanted:
        """The wanted motion, and the virtual control."""
        body, rate = self.observer.model.diaphragm, self.position_gain
        error, error_rate = estimate.position - reference.position, estimate.velocity - reference.velocity
        velocity = reference.velocity - rate * error
        acceleration = reference.acceleration - rate * error_rate
        # Its damping is that of the wanted velocity, so that the true one keeps its own.
        resistance = self.observer.friction(estimate, velocity) + estimate.load
        vacuum = jnp.zeros_like(ambient)
        free = self.observer.model.acceleration(estimate.position, velocity, resistance, vacuum, ambient)
        demand = acceleration - self.velocity_gain * (estimate.velocity - velocity)
        pressure = body.mass / body.area * (free - demand)
        return Wanted(velocity, acceleration, reference.jerk + rate**2 * error_rate, pressure)

    def wanted_rate(self, estimate: LoadEstimate, wanted: Wanted) -> Scalar:
        """`p*'` in Pa/s along the wanted motion."""
        model = self.observer.model
        elastic = model.load * model.friction.bristle_stiffness * (1 + estimate.level) * estimate.deflection_rate
        body = model.diaphragm
        braking = model.sliding_damping * wanted.acceleration + body.mass * wanted.jerk
        return -(body.stiffness * wanted.velocity + elastic + braking) / body.area

    def lyapunov(self, estimate: LoadEstimate, reference: Reference, ambient: Scalar) -> Scalar:
        """`V_C` in m2/s4: the energy of the mass, spring and damper that the velocity's error is, over its mass."""
        body, wanted = self.observer.model.diaphragm, self.wanted(estimate, reference, ambient)
        surface = estimate.velocity - wanted.velocity
        braking = self.observer.model.sliding_damping / body.mass + self.velocity_gain
        surface_rate = -braking * surface - body.area / body.mass * (estimate.pressure - wanted.pressure)
        stiffness = body.stiffness / body.mass + self.pressure_gain * braking
        return 0.5 * (surface_rate**2 + stiffness * surface**2)

    def _duty(self, estimate: LoadEstimate, wanted: Wanted, ambient: Scalar) -> Scalar:
        model = self.observer.model
        rate = self.wanted_rate(estimate, wanted) - self.pressure_gain * (estimate.pressure - wanted.pressure)
        flow = model.flow_for(rate, estimate.position, estimate.velocity, estimate.pressure)
        return model.flow_map.duty_for(flow, estimate.pressure, ambient)


def _velocity_lag(lag: Scalar, follows: Scalar, reference: Reference, period: float) -> Scalar:
    """By how much in m/s a rod stays behind its reference one sample later, between none and the whole velocity.

    It grows by what the reference accelerates while the rod follows less than wholly. A reference that rests leaves
    none, so that nothing stays behind, whatever was missed before.
    """
    missed = lag + period * (1 - follows) * reference.acceleration
    return jnp.clip(missed, jnp.minimum(reference.velocity, 0.0), jnp.maximum(reference.velocity, 0.0))
