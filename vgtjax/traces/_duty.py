"""The duty that reaches the valve, when that is later or earlier than its record says."""

from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._types import Scalar


def delay_duty(
    duty: Float[Array, " time"], duration: Float[Array, " time"], delay: Scalar, side: Literal["left", "right"] = "left"
) -> Float[Array, " time"]:
    """Mean duty in percent over every interval, of a held duty that arrives `delay` s late.

    The mean over an interval is continuous in the delay, with a kink where an edge passes a sample; before the first
    sample the duty was that of the first. Intervals without length keep their duty.

    **Arguments:** `duty` held from its sample to the next; `duration` of every interval in s. By the `side` the
    derivative at a kink is that of a duty a little later (left) or earlier.
    """
    ends = jnp.cumsum(duration)
    begins = ends - duration
    area = jnp.cumsum(duty * duration) - duty * duration  # up to the start of every interval

    def integral(time: Array) -> Array:
        index = jnp.clip(jnp.searchsorted(begins, time, side=side) - 1, 0)
        return area[index] + duty[index] * (time - begins[index])

    present = duration > 0
    mean = (integral(ends - delay) - integral(begins - delay)) / jnp.where(present, duration, 1.0)
    return jnp.where(present, mean, duty)


FARTHEST_EDGE = 2
"""Samples by which an edge is moved at most."""
APART = 1e-6
"""s that an edge keeps from the times of a trace: far below what moves anything."""
HELD = 5
"""Samples for which a duty is the same before and after what is an edge, and no ramp."""


def edges_of(duty: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " edges"]:
    """Numbers of the samples at which a duty jumps from one level that it has held to another."""
    jumps = np.flatnonzero(np.diff(duty)) + 1
    held = np.diff(jumps, prepend=-HELD, append=len(duty) + HELD)
    return jumps[(held[:-1] >= HELD) & (held[1:] >= HELD)]


def inside(times: Float[np.ndarray, " edges"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " edges"]:
    """Times, those before or behind a clock next to its ends, one after the other."""
    places = 2 * APART * np.arange(1, len(times) + 1)
    return np.clip(times, clock[0] + places, clock[-1] - places[::-1])


def beside(times: Float[np.ndarray, " edges"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " edges"]:
    """Times, those that a clock has already a little earlier, so that they are times more."""
    after = np.clip(np.searchsorted(clock, times), 1, len(clock) - 1)
    nearest = np.where(times - clock[after - 1] < clock[after] - times, clock[after - 1], clock[after])
    return np.where(np.abs(times - nearest) < APART, nearest - APART, times)
