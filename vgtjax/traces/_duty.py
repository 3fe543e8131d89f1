"""The duty that reaches the valve, when that is later or earlier than its record says."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._types import Scalar
from ._drive import Jump

Series = Float[Array, " time"]


def delay_duty(duty: Series, duration: Series, delay: Scalar) -> tuple[Series, Jump]:
    """A held duty in percent that arrives `delay` s late: at the start of every interval, and where it jumps inside.

    Where it does so more than once, its mean over the interval counts. Before the first sample the duty was that of the
    first; intervals without length keep their duty. Derivatives are those of a duty a little later.

    **Arguments:** `duty` held from its sample to the next; `duration` of every interval in s.
    """
    ends = jnp.cumsum(duration)
    begins = ends - duration
    area = jnp.cumsum(duty * duration) - duty * duration  # up to the start of every interval
    before, behind = (jnp.clip(jnp.searchsorted(begins, time - delay) - 1, 0) for time in (begins, ends))

    def integral(time: Series, index: Int[Array, " time"]) -> Series:
        return area[index] + duty[index] * (time - delay - begins[index])

    jumps = jnp.cumsum(jnp.diff(duty, prepend=duty[:1]) != 0)
    count, last = jumps[behind] - jumps[before], jnp.searchsorted(jumps, jumps[behind])
    present = duration > 0
    length = jnp.where(present, duration, 1.0)
    mean = (integral(ends, behind) - integral(begins, before)) / length
    held = jnp.where(present, jnp.where(count > 1, mean, duty[before]), duty)
    once = present & (count == 1)
    height, place = duty[behind] - duty[before], (begins[last] + delay - begins) / length
    return held, Jump(jnp.where(once, height, 0.0), jnp.where(once, place, 0.0))


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
    nearest = _nearest(times, clock)
    return np.where(np.abs(times - nearest) < APART, nearest - APART, times)


def onto(times: Float[np.ndarray, " jumps"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " jumps"]:
    """Times, those next to one that a clock has already at that."""
    nearest = _nearest(times, clock)
    return np.where(np.abs(times - nearest) < APART, nearest, times)


def _nearest(times: Float[np.ndarray, " some"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " some"]:
    after = np.clip(np.searchsorted(clock, times), 1, len(clock) - 1)
    return np.where(times - clock[after - 1] < clock[after] - times, clock[after - 1], clock[after])
