"""Feedback linearisation with a friction observer [5.6-5.9] (Canudas de Wit, Olsson, Astrom and Lischinsky, 1995)."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._types import Scalar
from ...parameters import parameter
from ...parts import AbstractVaneForce, Converter, Diaphragm, LuGre, NoVaneForce
from ...plants import AbstractPlant, require_converter
from .._base import AbstractController, Log, Measurement, Memory, Reference
from .._design import Condition
from .._design_model import Motion, lugre_of, vane_load, vane_state_after
from ..observers import AbstractDifferentiator, LevantDifferentiator
from ._balance import holding_duty

ABOVE_BOUND = 1.5
"""Least derivative gain of a design for a plant, in parts of the bound of [5.9]."""


class ObserverState(eqx.Module):
    """Observed deflection of the bristles in m, and what vanes and differentiator remember."""

    deflection: Scalar
    vanes: PyTree[Scalar]
    differentiator: Memory


class FrictionCompensation(AbstractController):
    """A PD on the position error, with the model's spring, inertia, vanes and observed friction added [5.6-5.8].

    The duty is the one that holds the chamber pressure of that force. The manual's page of derivations has the law, its
    derivation and where the print differs.

    **Raises:** `InputError` where the transfer function [5.9] is not strictly positive real.
    """

    proportional_gain: Scalar = parameter(12000.0, symbol="k_p", unit="N/m", source="5.8, value assumed")
    derivative_gain: Scalar = parameter(200.0, symbol="k_d", unit="N s/m", source="5.8, value assumed")
    observer_gain: Scalar = parameter(10.0, symbol="k", unit="1/s", source="5.6, value assumed")
    load: Scalar = parameter(1.0, symbol="theta", unit="1", source="5.7", held=True)
    converter: Converter = eqx.field(default_factory=Converter)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: LuGre = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(0.7, width=2e-3))

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "FrictionCompensation":
        """With the default damping, or with half as much again as [5.9] asks for; the vane force is left unknown."""
        body, friction = plant.diaphragm, lugre_of(plant)
        gain = jnp.maximum(cls.derivative_gain, ABOVE_BOUND * least_derivative_gain(body, friction))
        design: dict[str, Any] = {
            "derivative_gain": gain,
            "converter": require_converter(plant, cls.__name__),
            "diaphragm": body,
            "friction": friction,
        }
        return cls(**design | settings)

    def conditions(self) -> dict[str, Condition]:
        """[5.9] is strictly positive real: `sigma_1 (b_d + k_d) > sigma_0 m` and `k_p + k_sm > 0`."""
        bound, spring = least_derivative_gain(self.diaphragm, self.friction), self.diaphragm.stiffness
        return {
            "derivative_gain above its bound [5.9]": Condition(
                (self.derivative_gain - bound) / jnp.maximum(jnp.abs(bound), 1.0),
                "derivative_gain must exceed {limit:.4g} N s/m for a strictly positive real [5.9]",
                self.derivative_gain,
                "raise it",
                bound,
            ),
            "proportional_gain above its bound [5.9]": Condition(
                1 + self.proportional_gain / spring,
                "proportional_gain must exceed minus the spring's {limit:.4g} N/m for a strictly positive real [5.9]",
                self.proportional_gain,
                "raise it",
                spring,
            ),
        }

    def initial_state(self, measurement: Measurement) -> ObserverState:
        """Relaxed bristles, at rest."""
        position = measurement.position
        vanes = self.vane_force.initial_state()
        return ObserverState(jnp.zeros_like(position), vanes, self.differentiator.initial_state(position))

    def update(
        self, state: ObserverState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[ObserverState, Scalar, Log]:
        """See the base class; logs `velocity` in m/s, `friction` in N and the `wanted_pressure` in Pa absolute."""
        memory, velocity = self.differentiator.update(
            state.differentiator, measurement.position, period, reference.velocity
        )
        error, error_rate = measurement.position - reference.position, velocity - reference.velocity
        deflection, friction = self._observe(state.deflection, velocity, error, period)
        body = self.diaphragm
        motion = Motion(measurement.position, velocity, measurement.ambient, measurement.turbine)
        vanes = vane_state_after(self.vane_force, body, motion, state.vanes, period)
        force = (
            body.preload
            + friction
            + vane_load(self.vane_force, body, motion, vanes)[0]
            - self.proportional_gain * error
            - self.derivative_gain * error_rate
            + body.mass * reference.acceleration
            + body.damping * reference.velocity
            + body.stiffness * reference.position
        )
        pressure = measurement.ambient - force / body.area
        duty = holding_duty(self.converter, measurement, pressure)
        log = {"velocity": velocity, "friction": friction, "wanted_pressure": pressure}
        return ObserverState(deflection, vanes, memory), duty, log

    def _observe(self, deflection: Scalar, velocity: Scalar, error: Scalar, period: float) -> tuple[Scalar, Scalar]:
        """A deflection in m one sample later, and the friction force in N."""
        onward = self.friction.deflection_after(deflection, velocity - self.observer_gain * error, velocity, period)
        return onward, self.load * self.friction.unloaded_force(onward, (onward - deflection) / period, velocity)


def least_derivative_gain(body: Diaphragm, friction: LuGre) -> Scalar:
    """`sigma_0 m / sigma_1 - b_d` in N s/m, which `k_d` has to exceed [5.9]."""
    return friction.bristle_stiffness * body.mass / friction.bristle_damping - body.damping
