"""Linear active disturbance rejection: an extended state observer, and what it observes cancelled (Gao, 2003)."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference, saturate
from .._design import Condition, positive
from ._balance import StaticBalance, duty_against

POLE = 40.0
"""1/s; a pole that stands for chamber and damping together, so that `b_0` of a plant is `POLE^2` over its duty per
metre."""


class ExtendedState(eqx.Module):
    """Position in m, velocity in m/s and disturbance in m/s2 as observed, the last duty beyond the base in percent, and
    what the base remembers."""

    position: Scalar
    velocity: Scalar
    disturbance: Scalar
    duty: Scalar
    base: Memory


class ADRC(AbstractController):
    """`x'' = f + b_0 u`, all of `f` observed and cancelled: `u = u_base + (w_c^2 e + 2 w_c e' + x_ref'' - f) / b_0`.

    The observer has its three poles at `-w_o` (Gao, 2003), in discrete time as a current estimator (Miklosovic,
    Radke and Gao, 2006): any positive bandwidth is stable there. Only `b_0` is told of the plant, and `base`, by
    default the static balance. The observer is given the duty that was sent, so that saturation winds up nothing.
    """

    control_bandwidth: Scalar = parameter(30.0, symbol="w_c", unit="1/s", source="assumed")
    observer_bandwidth: Scalar = parameter(150.0, symbol="w_o", unit="1/s", source="assumed")
    input_gain: Scalar = parameter(0.5, symbol="b_0", unit="m/(% s2)", source="assumed")
    base: AbstractController = eqx.field(default_factory=StaticBalance)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "ADRC":
        """Around the plant's [`StaticBalance`][], with `b_0` from its duty per metre."""
        gain = POLE**2 / _duty_slope(plant)
        return cls(**{"base": StaticBalance.for_plant(plant), "input_gain": gain} | settings)

    def conditions(self) -> dict[str, Condition]:
        """An observer that is faster than what is controlled with it, and a plant that the duty moves."""
        return positive(self, "control_bandwidth", "input_gain") | {
            "observer_bandwidth above the control's": Condition(
                1 - self.control_bandwidth / self.observer_bandwidth,
                "observer_bandwidth must exceed control_bandwidth = {limit:.4g} 1/s",
                self.observer_bandwidth,
                "raise it",
                self.control_bandwidth,
            )
        }

    def initial_state(self, measurement: Measurement) -> ExtendedState:
        """At rest where it is measured."""
        none = jnp.zeros_like(measurement.position)
        return ExtendedState(measurement.position, none, none, none, self.base.initial_state(measurement))

    def update(
        self, state: ExtendedState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[ExtendedState, Scalar, Log]:
        """See the base class; logs the observed `velocity` in m/s and `disturbance` in m/s2."""
        position, velocity, disturbance = self._observe(state, measurement.position, period)
        base, held, _ = self.base.update(state.base, measurement, reference, period)
        bandwidth = self.control_bandwidth
        wanted = (
            bandwidth**2 * (reference.position - position)
            + 2 * bandwidth * (reference.velocity - velocity)
            + reference.acceleration
        )
        command = held + (wanted - disturbance) / self.input_gain
        onward = ExtendedState(position, velocity, disturbance, saturate(command) - held, base)
        return onward, command, {"velocity": velocity, "disturbance": disturbance}

    def _observe(self, state: ExtendedState, measured: Scalar, period: float) -> tuple[Scalar, Scalar, Scalar]:
        """Three integrators one sample on, corrected by what is measured then."""
        push = state.disturbance + self.input_gain * state.duty
        position = state.position + period * state.velocity + 0.5 * period**2 * push
        velocity = state.velocity + period * push
        keep = jnp.exp(-self.observer_bandwidth * period)
        error = measured - position
        return (
            position + (1 - keep**3) * error,
            velocity + 1.5 * (1 - keep) ** 2 * (1 + keep) / period * error,
            state.disturbance + (1 - keep) ** 3 / period**2 * error,
        )


def _duty_slope(plant: AbstractPlant) -> Scalar:
    """Duty in percent per metre of position that holds a plant in the middle of its travel."""
    force = plant.diaphragm.stiffness * 1e-3
    return (duty_against(plant, force) - duty_against(plant, -force)) / 2e-3
