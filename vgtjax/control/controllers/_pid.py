"""Conventional control: PI and PID with anti-windup [section 5.3]."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference, saturate
from ..observers import AbstractDifferentiator, FilteredDifference
from ._balance import ConstantDuty, StaticBalance


class PIState(eqx.Module):
    """The integral part in percent, and what the base controller remembers."""

    integral: Scalar
    base: Memory


class PI(AbstractController):
    """`u = u_base + k_p e + I`, `I' = k_i e + (u_saturated - u) / T_t`, `e` reference minus position.

    The last term is back-calculation (Astrom and Hagglund, 1995): while the duty saturates, the integral gives up,
    with the time constant `T_t`, what could not act; an infinite `T_t` is none. `base` is what the PI corrects: a
    constant duty of zero, or e.g. [`StaticBalance`][].
    """

    proportional_gain: Scalar = parameter(6000.0, symbol="k_p", unit="%/m", source="5.3, value assumed")
    integral_gain: Scalar = parameter(20000.0, symbol="k_i", unit="%/(m s)", source="5.3, value assumed")
    tracking_time: Scalar = parameter(0.1, symbol="T_t", unit="s", source="assumed", infinite=True)
    base: AbstractController = eqx.field(default_factory=ConstantDuty)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "PI":
        """Around the plant's [`StaticBalance`][]."""
        return cls(**{"base": StaticBalance.for_plant(plant)} | settings)

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return self.base.observes

    def initial_state(self, measurement: Measurement) -> PIState:
        """Nothing integrated."""
        return PIState(jnp.zeros_like(measurement.position), self.base.initial_state(measurement))

    def update(
        self, state: PIState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[PIState, Scalar, Log]:
        """See the base class; logs the `integral` part in percent."""
        return self.correct(state, measurement, reference, period, jnp.zeros_like(measurement.position))

    def correct(
        self, state: PIState, measurement: Measurement, reference: Reference, period: float, extra: Scalar
    ) -> tuple[PIState, Scalar, Log]:
        """As `update`, with a duty in percent that somebody else adds before the duty saturates."""
        base, duty, log = self.base.update(state.base, measurement, reference, period)
        error = reference.position - measurement.position
        command = duty + self.proportional_gain * error + state.integral + extra
        # No faster than dead-beat, so that a short tracking time is not unstable in discrete time.
        unwind = period / (self.tracking_time + period)
        integral = state.integral + period * self.integral_gain * error + unwind * (saturate(command) - command)
        return PIState(integral, base), command, {**log, "integral": state.integral}


class PIDState(eqx.Module):
    """What the PI and the differentiator remember."""

    pi: PIState
    differentiator: Memory


class PID(AbstractController):
    """A PI that also brakes by `-k_d v`: the derivative acts on the measurement alone, so that steps don't kick."""

    pi: PI = eqx.field(default_factory=PI)
    derivative_gain: Scalar = parameter(200.0, symbol="k_d", unit="% s/m", source="5.3, value assumed")
    differentiator: AbstractDifferentiator = eqx.field(default_factory=FilteredDifference)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "PID":
        """With the [`PI`][] for the plant."""
        return cls(**{"pi": PI.for_plant(plant)} | settings)

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return self.pi.observes

    def initial_state(self, measurement: Measurement) -> PIDState:
        """Nothing integrated, and at rest."""
        return PIDState(self.pi.initial_state(measurement), self.differentiator.initial_state(measurement.position))

    def update(
        self, state: PIDState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[PIDState, Scalar, Log]:
        """See the base class; logs the `integral` part in percent and the estimated `velocity` in m/s."""
        memory, velocity = self.differentiator.update(state.differentiator, measurement.position, period)
        braking = -self.derivative_gain * velocity
        pi, command, log = self.pi.correct(state.pi, measurement, reference, period, braking)
        return PIDState(pi, memory), command, {**log, "velocity": velocity}
