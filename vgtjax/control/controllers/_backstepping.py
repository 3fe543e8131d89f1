"""Backstepping from the position alone, with observed pressure and friction [5.22-5.43]."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference, saturate
from .._design import Condition, positive
from .._design_model import DesignModel, Motion, lighter
from ..observers import AbstractDifferentiator, LevantDifferentiator, ObservedState, PressureObserver


def _differentiator() -> AbstractDifferentiator:
    return LevantDifferentiator(1.0, width=2e-3)


class BacksteppingState(eqx.Module):
    """What was observed at the last sample, what the differentiator remembers, and the duty since then in percent."""

    observed: ObservedState
    differentiator: Memory
    duty: Scalar


class Backstepping(AbstractController):
    """Backstepping on the [`DesignModel`][], with a [`PressureObserver`][]; only the position is measured [5.22-5.35].

    With `s1 = e1' + lambda e1` and `e1 = x - x_ref`, the wanted pressure `p*` makes `s1' = -K_d s1`, and the flow that
    is asked for makes the observed pressure follow it. The manual's page of derivations has the proof, and how gains
    were chosen.

    **Raises:** `InputError` for a gain that is not positive.
    """

    position_gain: Scalar = parameter(45.0, symbol="lambda", unit="1/s", source="5.22, value assumed")
    velocity_gain: Scalar = parameter(1200.0, symbol="K_d", unit="1/s", source="5.34, value assumed")
    pressure_gain: Scalar = parameter(400.0, symbol="K_U", unit="1/s", source="5.34, value assumed")
    pressure_weight: Scalar = parameter(2.5e-7, symbol="w", unit="m2/(s2 Pa2)", source="5.36, value assumed")
    reversal_width: Scalar = parameter(3e-3, symbol="v_w", unit="m/s", source="assumed", held=True)
    observer: PressureObserver = eqx.field(default_factory=PressureObserver)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=_differentiator)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any) -> "Backstepping":
        """On the plant's [`DesignModel`][] or another one; `K_d` and `w` in inverse proportion to its mass.

        The mass is a gain of the loop: the default gains are those of the printed one, and keep their forces like this.
        """
        model = DesignModel.for_plant(plant) if model is None else model
        scaled = {name: lighter(model) * getattr(cls, name) for name in ("velocity_gain", "pressure_weight")}
        return cls(**{"observer": PressureObserver.for_plant(plant, model)} | scaled | settings)

    def conditions(self) -> dict[str, Condition]:
        """Any positive gains; what the observer asks for is its own."""
        return positive(self, "position_gain", "velocity_gain", "pressure_gain", "pressure_weight")

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return frozenset({"pressure", "velocity_error"})

    def initial_state(self, measurement: Measurement) -> BacksteppingState:
        """At rest, with the chamber at atmosphere."""
        observed = self.observer.initial_state(measurement.ambient)
        memory = self.differentiator.initial_state(measurement.position)
        return BacksteppingState(observed, memory, jnp.zeros_like(measurement.position))

    def update(
        self, state: BacksteppingState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[BacksteppingState, Scalar, Log]:
        """See the base class.

        Logs `velocity` in m/s and by how much the observer's differs from it, `velocity_error`, the observed `pressure`
        in Pa absolute, `deflection` in m and `friction` in N, and the `wanted_pressure` in Pa absolute.
        """
        expected, position = reference.velocity, measurement.position
        memory, velocity = self.differentiator.update(state.differentiator, position, period, expected)
        position = self.differentiator.value(memory, period, expected)
        motion = Motion(position, velocity, measurement.ambient, measurement.turbine)
        observed, rate = self.observer.step(state.observed, motion, state.duty, period)
        wanted = self.wanted_pressure(motion, observed, reference)
        duty = self._duty(motion, observed, rate, wanted, reference)
        log = {
            "velocity": velocity,
            "velocity_error": velocity - observed.velocity,
            "pressure": observed.pressure,
            "deflection": observed.deflection,
            "friction": self.observer.model.friction_force(velocity, observed.deflection),
            "wanted_pressure": wanted,
        }
        return BacksteppingState(observed, memory, saturate(duty)), duty, log

    def surface(self, motion: Motion, reference: Reference) -> Array:
        """`s1` in m/s [5.22]."""
        error = motion.position - reference.position
        return motion.velocity - reference.velocity + self.position_gain * error

    def wanted_pressure(self, motion: Motion, observed: ObservedState, reference: Reference) -> Array:
        """The virtual control `p*` in Pa absolute, which the observed pressure takes no part in."""
        body = self.observer.model.diaphragm
        # The drive at which nothing accelerates, less what the error wants.
        balance = self._acceleration(motion, observed, jnp.zeros_like(observed.pressure))
        error_rate = motion.velocity - reference.velocity
        demand = (
            self.position_gain * error_rate
            + self.velocity_gain * self.surface(motion, reference)
            - reference.acceleration
        )
        return body.mass / body.area * (balance + demand)

    def wanted_pressure_rate(
        self, motion: Motion, observed: ObservedState, deflection_rate: Scalar, reference: Reference
    ) -> Array:
        """`p*'` in Pa/s along the observed motion; `deflection_rate` is `zh'` in m/s."""
        model, body, velocity = self.observer.model, self.observer.model.diaphragm, motion.velocity
        acceleration = model.stopped(motion.position, self._acceleration(motion, observed, observed.pressure))
        bristles = model.stiffness_slope(velocity, self.reversal_width) * observed.deflection
        braking = model.damping + model.load * bristles
        surface_rate = acceleration - reference.acceleration + self.position_gain * (velocity - reference.velocity)
        force_rate = (
            body.stiffness * velocity
            + (braking - self.position_gain * body.mass) * acceleration
            + model.load * model.stiffness(velocity) * deflection_rate
            + model.vane_load_rate(motion, observed.vanes)
            + body.mass * (reference.jerk + self.position_gain * reference.acceleration)
            - body.mass * self.velocity_gain * surface_rate
        )
        return -force_rate / body.area

    def _acceleration(self, motion: Motion, observed: ObservedState, pressure: Scalar) -> Scalar:
        """Of the rod in m/s2 at a pressure in Pa absolute, with friction and vanes as observed."""
        model = self.observer.model
        friction = model.friction_force(motion.velocity, observed.deflection)
        resistance = friction + model.vane_load(motion, observed.vanes)[0]
        return model.acceleration(motion.position, motion.velocity, resistance, pressure, motion.ambient)

    def _duty(
        self, motion: Motion, observed: ObservedState, deflection_rate: Scalar, wanted: Scalar, reference: Reference
    ) -> Scalar:
        model, body = self.observer.model, self.observer.model.diaphragm
        wanted_rate = self.wanted_pressure_rate(motion, observed, deflection_rate, reference)
        coupling = body.area / (body.mass * self.pressure_weight) * self.surface(motion, reference)
        rate = wanted_rate + coupling - self.pressure_gain * (observed.pressure - wanted)
        flow = model.flow_for(rate, motion.position, motion.velocity, observed.pressure)
        return model.flow_map.duty_for(flow, observed.pressure, motion.ambient)
