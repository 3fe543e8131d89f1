"""Signals of what goes on around an actuator again and again: pulsation, and draws on its vacuum."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._errors import InputError, require_positive
from ..._types import Scalar
from ._reference import SECONDS, AbstractSignal, number


class Periodic(AbstractSignal):
    """Values at even distances over one `period` in s, linear between them, again and again."""

    values: Float[Array | np.ndarray, " samples"] = number()
    period: Scalar = number()

    def __check_init__(self) -> None:
        require_positive("period", self.period, *SECONDS)

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        count = self.values.shape[0]
        place = jnp.mod(time / self.period, 1.0) * count
        before = jnp.floor(place)
        low, high = (self.values[(before.astype(int) + step) % count] for step in (0, 1))
        return low + (place - before) * (high - low)


class Draws(AbstractSignal):
    """A reservoir that sinks and sags: `level + drift t`, and `depth` more at each of some times, which then recovers.

    In Pa and s. Each draw jumps, as another consumer opens, and dies away with the time constant `recovery`.

    **Arguments:** `times` in s, of shape `(draws,)`; none are allowed.

    **Raises:** `InputError` for a recovery that is not positive, or times of another shape.
    """

    level: Scalar = number()
    drift: Scalar = number(default=0.0)
    times: Float[Array | np.ndarray, " draws"] = number(default=())
    depth: Scalar = number(default=0.0)
    recovery: Scalar = number(default=0.5)

    def __check_init__(self) -> None:
        require_positive("recovery", self.recovery, *SECONDS)
        if self.times.ndim < 1:
            raise InputError(f"times of draws must be a list, but they are {self.times}; give e.g. [1.0, 4.0]")

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        since = time - self.times
        left = jnp.where(since >= 0, jnp.exp(-jnp.maximum(since, 0.0) / self.recovery), 0.0)
        return self.level + self.drift * time + self.depth * jnp.sum(left)
