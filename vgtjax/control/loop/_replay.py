"""A controller on what was measured before: without a plant, so that what it does with its measurements can be seen."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar
from .._base import AbstractController, Log, Measurement, Reference
from .._held import Held, answer, begin

PROBES = {"position": 1e-5, "pressure": 1e3, "reservoir": 1e3, "turbine": 1e4}
"""m and Pa; changes of each measured channel that are no noise, and that a controller which uses it answers."""


@eqx.filter_jit
def replay(
    controller: AbstractController, measured: Measurement, reference: Reference, period: float
) -> tuple[Float[Array, " time"], Log]:
    """The command in percent and the log that a controller gives to measurements and references, one value per sample.

    Its command moves nothing here: what it is given is the same whatever it does.
    """

    return step_through(controller, measured, reference, period, lambda before, after, *answered: answered)


def step_through(
    controller: AbstractController,
    measured: Measurement,
    reference: Reference,
    period: float,
    look: Callable[[Held, Held, Scalar, Log], Any],
) -> Any:
    """What `look` makes of every sample, of what is remembered before and after it, the command and the log."""

    def sample(before: Held, given: tuple[Measurement, Reference]) -> tuple[Held, Any]:
        after, command, log = answer(controller, before, *given, period)
        return after, look(before, after, command, log)

    first = jax.tree.map(lambda leaf: leaf[0], measured)
    return jax.lax.scan(sample, begin(controller, first), (measured, reference))[1]


def channels_used(
    controller: AbstractController, measured: Measurement, reference: Reference, period: float
) -> tuple[str, ...]:
    """Which of the channels of [`PROBES`][] a controller makes use of, found out by changing each of them.

    **Arguments:** as [`replay`][]; a few hundred samples of a run will do.
    """
    usual, _ = replay(controller, measured, reference, period)

    def answers(channel: str) -> bool:
        changed = dataclasses.replace(measured, **{channel: getattr(measured, channel) + PROBES[channel]})
        return not jnp.array_equal(replay(controller, changed, reference, period)[0], usual, equal_nan=True)

    return tuple(channel for channel in PROBES if answers(channel))
