"""A PI as production has it: gains over the position, and dry friction fed forward."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Reference
from .._design_model import DesignModel, lugre_of
from ._balance import StaticBalance, duty_against
from ._pid import PI, PIState

KNOTS = (0.2, 0.5, 0.8)
"""Shares of the travel: a gain at a place where no reference goes is told by nothing, and tuned to anything."""
SLOW = 3e-3
"""m/s; a velocity at which the rod slides and the plunger works, on either side of its seats."""


class ScheduledPI(AbstractController):
    """`u = u_base + k_p(x_ref) e + I + u_f v_ref / (|v_ref| + v_w) + k_v v_ref`, `I' = k_i(x_ref) e`, with anti-windup.

    A [`PI`][] whose gains are linear between knots over the reference's position. Half the width of the hysteresis, as
    a duty, is fed forward with the sign of the reference's velocity, and in proportion to it the duty whose flow moves
    the rod.
    """

    proportional_gain: Float[Array, " 3"] = parameter(
        (3000.0, 3000.0, 3000.0), symbol="k_p", unit="%/m", source="assumed"
    )
    integral_gain: Float[Array, " 3"] = parameter(
        (20000.0, 20000.0, 20000.0), symbol="k_i", unit="%/(m s)", source="assumed"
    )
    tracking_time: Scalar = parameter(0.1, symbol="T_t", unit="s", source="assumed", infinite=True)
    friction_duty: Scalar = parameter(2.0, symbol="u_f", unit="%", source="assumed")
    velocity_gain: Scalar = parameter(1100.0, symbol="k_v", unit="% s/m", source="assumed", positive=False)
    sign_width: Scalar = parameter(2e-4, symbol="v_w", unit="m/s", source="assumed", held=True, above=0.0)
    knots: Float[Array, " 3"] = parameter(
        (0.002, 0.005, 0.008), symbol="x_k", unit="m", source="assumed", held=True, positive=False
    )
    """Positions; beyond the outermost, gains are theirs."""
    base: AbstractController = eqx.field(default_factory=StaticBalance)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any) -> "ScheduledPI":
        """Around the plant's [`StaticBalance`][], with its friction as a duty and knots over its travel; the duty of a
        velocity is that of the plant's [`DesignModel`][], or another one."""
        model = DesignModel.for_plant(plant) if model is None else model
        design: dict[str, Any] = {"base": StaticBalance.for_plant(plant), "friction_duty": friction_as_duty(plant)}
        design["velocity_gain"] = velocity_as_duty(model)
        if np.isfinite(plant.diaphragm.travel):
            design["knots"] = plant.diaphragm.travel * jnp.asarray(KNOTS)
        return cls(**design | settings)

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return self.base.observes

    def initial_state(self, measurement: Measurement) -> PIState:
        """Nothing integrated."""
        return self._pi(measurement.position).initial_state(measurement)

    def update(
        self, state: PIState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[PIState, Scalar, Log]:
        """See the base class; logs the `integral` part and the `feedforward` in percent."""
        velocity = reference.velocity
        sign = velocity / (jnp.abs(velocity) + self.sign_width)
        forward = self.friction_duty * sign + self.velocity_gain * velocity
        onward, command, log = self._pi(reference.position).correct(state, measurement, reference, period, forward)
        return onward, command, {**log, "feedforward": forward}

    def _pi(self, position: Scalar) -> PI:
        return PI(
            proportional_gain=jnp.interp(position, self.knots, self.proportional_gain),
            integral_gain=jnp.interp(position, self.knots, self.integral_gain),
            tracking_time=self.tracking_time,
            base=self.base,
        )


def friction_as_duty(plant: AbstractPlant) -> Scalar:
    """Half the width of a plant's hysteresis in the middle of its travel, as a duty in percent.

    **Raises:** `InputError` for a plant without LuGre friction.
    """
    low, high = (duty_against(plant, sign * lugre_of(plant).coulomb_force) for sign in (-1, 1))
    return 0.5 * (high - low)


def velocity_as_duty(model: DesignModel) -> Scalar:
    """Duty in percent per m/s whose flow fills the chamber as the rod goes through the middle of its travel."""
    body, ambient = model.diaphragm, model.flow_map.ambient
    middle = body.middle
    pressure = body.balance_pressure(ambient, middle)

    def duty(velocity: Scalar) -> Scalar:
        rate = -body.stiffness * velocity / body.area
        return model.flow_map.duty_for(model.flow_for(rate, middle, velocity, pressure), pressure, ambient)

    slow = jnp.full_like(pressure, SLOW)
    return (duty(slow) - duty(-slow)) / (2 * SLOW)
