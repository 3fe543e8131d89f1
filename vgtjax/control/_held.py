"""What stands for a measurement that is no number: the last one that was."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Scalar
from ..traces import ASSUMED_RESERVOIR, STANDARD_ATMOSPHERE
from ._base import AbstractController, Log, Measurement, Memory, Reference


class Held(eqx.Module):
    """What a controller remembers, and the last number that each channel has shown.

    `good` is `None` for a controller that is to see what is no number.
    """

    controller: Memory
    good: Measurement | None


def begin(controller: AbstractController, measurement: Measurement) -> Held:
    """What a controller remembers before the first sample, whose measurement is given."""
    if controller.sees_gaps:
        return Held(controller.initial_state(measurement), None)
    good = numbers(measurement, nominal(measurement))
    return Held(controller.initial_state(good), good)


def answer(
    controller: AbstractController, held: Held, measurement: Measurement, reference: Reference, period: float
) -> tuple[Held, Scalar, Log]:
    """One sample of a controller, which is only shown numbers: what it remembers, its duty in percent, and its log."""
    good = None if held.good is None else numbers(measurement, held.good)
    shown = measurement if good is None else good
    memory, command, log = controller.update(held.controller, shown, reference, period)
    return Held(memory, good), command, log


def numbers(given: Measurement, other: Measurement) -> Measurement:
    """Every channel that is a number, and that of another measurement where it is none."""
    return jax.tree.map(lambda value, last: jnp.where(jnp.isfinite(value), value, last), given, other)


def nominal(measurement: Measurement) -> Measurement:
    """A rod at rest on its open stop, in place of what was never measured."""
    values = {"position": 0.0, "reservoir": ASSUMED_RESERVOIR, "turbine": 0.0}
    known = {name: STANDARD_ATMOSPHERE for name in ("pressure", "ambient")} | values
    return Measurement(**{name: jnp.full_like(getattr(measurement, name), value) for name, value in known.items()})
