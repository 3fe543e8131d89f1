"""Open-loop duties: constant, or what holds the rod at the reference in static balance."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...parts import FULL_DUTY, Converter, Diaphragm
from ...plants import AbstractPlant, require_converter
from ...traces import ASSUMED_RESERVOIR
from .._base import AbstractController, Log, Measurement, Reference, saturate

HALVINGS = 12
"""Bring the duty to within 0.02 %, from where Newton's method converges."""
NEWTON_STEPS = 3
"""From there to rounding."""
LEAST_SLOPE = 1e-3
"""N/%; keeps Newton's step finite where the magnetic force is flat. The printed one has 0.0023 at zero and more after
it."""


class ConstantDuty(AbstractController):
    """The same duty at all times."""

    duty: Scalar = parameter(0.0, symbol="u_0", unit="%", source="chapter 5", positive=False)

    def initial_state(self, measurement: Measurement) -> None:
        """Nothing."""

    def update(
        self, state: None, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[None, Scalar, Log]:
        """See the base class."""
        return None, jnp.broadcast_to(self.duty, jnp.shape(measurement.position)), {}


class StaticBalance(AbstractController):
    """The duty that holds the rod at the reference, without friction and vane force [2.8, 2.34].

    `converter` and `diaphragm` are what the controller believes of the plant.
    """

    converter: Converter = eqx.field(default_factory=Converter)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "StaticBalance":
        """Of the plant's own converter and diaphragm."""
        believed = {"converter": require_converter(plant, cls.__name__), "diaphragm": plant.diaphragm}
        return cls(**believed | settings)

    def initial_state(self, measurement: Measurement) -> None:
        """Nothing."""

    def update(
        self, state: None, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[None, Scalar, Log]:
        """See the base class; logs the pressure of balance in Pa absolute, `balance_pressure`."""
        pressure = self.diaphragm.balance_pressure(measurement.ambient, reference.position)
        return None, holding_duty(self.converter, measurement, pressure), {"balance_pressure": pressure}


def holding_duty(converter: Converter, measurement: Measurement, pressure: Scalar) -> Scalar:
    """Duty in percent at which the plunger closes both orifices at a chamber pressure in Pa absolute [2.8].

    Within 0 and 100, an end where no duty between does it. The magnetic force must rise with the duty.
    """
    closed = jnp.zeros_like(pressure)

    def surplus(duty: Scalar) -> Any:
        pull = converter.magnetic_force.steady_pull(duty, closed)
        return -converter.static_force(pull, measurement.ambient, measurement.reservoir, pressure)

    def halve(_: Any, bracket: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bracket
        middle = 0.5 * (low + high)
        above = surplus(middle) > 0
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    low, high = jax.lax.fori_loop(0, HALVINGS, halve, (closed, closed + FULL_DUTY))
    duty = jax.lax.stop_gradient(0.5 * (low + high))
    # Bisection has no derivative; each of Newton's steps has the exact one, as far as it has converged.
    for _ in range(NEWTON_STEPS):
        value, slope = jax.jvp(surplus, (duty,), (jnp.ones_like(duty),))
        duty = saturate(duty - value / jnp.maximum(slope, LEAST_SLOPE))
    return duty


def duty_against(plant: AbstractPlant, force: Scalar) -> Scalar:
    """Duty in percent that holds the rod in the middle of its travel against one more force in N along -x."""
    body, ambient = plant.diaphragm, plant.air.pressure
    middle = body.middle
    pressure = body.balance_pressure(ambient, middle, force)
    measured = Measurement(middle, pressure, jnp.full_like(pressure, ASSUMED_RESERVOIR), ambient)
    return holding_duty(require_converter(plant, "a duty against a force"), measured, pressure)
