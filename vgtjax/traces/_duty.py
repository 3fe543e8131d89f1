"""The duty that reaches the valve, when that is later than its record says."""

import jax.numpy as jnp
from jaxtyping import Array, Float

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
