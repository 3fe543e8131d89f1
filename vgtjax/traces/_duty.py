"""The duty that reaches the valve, when that is later or earlier than its record says."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._types import Scalar


def delay_duty(duty: Float[Array, " time"], duration: Float[Array, " time"], delay: Scalar) -> Float[Array, " time"]:
    """Mean duty in percent over every interval, of a held duty that arrives `delay` s late.

    The mean over an interval is continuous in the delay, with a kink where an edge passes a sample; before the first
    sample the duty was that of the first. Intervals without length keep their duty.

    **Arguments:** `duty` held from its sample to the next; `duration` of every interval in s.
    """
    ends = jnp.cumsum(duration)
    begins = ends - duration
    area = jnp.cumsum(duty * duration) - duty * duration  # up to the start of every interval

    def integral(time: Array) -> Array:
        # From the left, so that the derivative at zero delay is that of a later duty, not of an earlier one.
        index = jnp.clip(jnp.searchsorted(begins, time, side="left") - 1, 0)
        return area[index] + duty[index] * (time - begins[index])

    present = duration > 0
    mean = (integral(ends - delay) - integral(begins - delay)) / jnp.where(present, duration, 1.0)
    return jnp.where(present, mean, duty)


HELD = 5
"""Samples for which a duty is the same before and after what is an edge, and no ramp."""


def edges_of(duty: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " edges"]:
    """Numbers of the samples at which a duty jumps from one level that it has held to another."""
    jumps = np.flatnonzero(np.diff(duty)) + 1
    held = np.diff(jumps, prepend=-HELD, append=len(duty) + HELD)
    return jumps[(held[:-1] >= HELD) & (held[1:] >= HELD)]


def mean_duty(
    began: Float[np.ndarray, " samples"], duty: Float[np.ndarray, " samples"], time: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Mean over every interval of `time` of a duty that is held from `began` on, the last one that of its beginning.

    The first and the last level are held beyond both ends.
    """
    area = np.append(0.0, np.cumsum(duty[:-1] * np.diff(began)))
    beyond = duty[0] * np.minimum(time - began[0], 0.0) + duty[-1] * np.maximum(time - began[-1], 0.0)
    integral = np.interp(time, began, area) + beyond
    last = duty[max(int(np.searchsorted(began, time[-1], side="right")) - 1, 0)]
    return np.append(np.diff(integral) / np.diff(time), last)
