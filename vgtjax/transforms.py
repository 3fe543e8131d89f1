"""The map between physical parameters and the unconstrained coordinates that an optimiser moves.

Positive parameters move by their logarithm, bounded ones by a logistic, the rest by their start value as scale,
so that a step of one in any coordinate is a large but sane change of that parameter.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.nn as jnn
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .errors import InputError
from .parameters import Parameter, table_row


class Transform(eqx.Module):
    """Entrywise bijection from `R` onto `(lower, upper)`, either of which may be infinite.

    All three arrays have shape `(parameters,)` and physical units.
    """

    lower: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)
    upper: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)
    scale: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)

    def to_physical(self, coordinates: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """Physical values of unconstrained coordinates."""
        below, above, lower, upper = self._ends()
        grown = jnp.exp(coordinates)
        one_sided = jnp.where(below, lower + grown, upper - grown)
        boxed = lower + (upper - lower) * jnn.sigmoid(coordinates)
        return jnp.where(below & above, boxed, jnp.where(below | above, one_sided, self.scale * coordinates))

    def to_unconstrained(self, values: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """Unconstrained coordinates of physical values strictly inside the bounds."""
        below, above, lower, upper = self._ends()
        to_lower = jnp.where(below, values - lower, 1.0)
        to_upper = jnp.where(above, upper - values, 1.0)
        logs = jnp.log(to_lower) - jnp.log(to_upper)
        one_sided = jnp.where(below, logs, -logs)
        return jnp.where(below & above, logs, jnp.where(below | above, one_sided, values / self.scale))

    def _ends(self) -> tuple[Array, Array, Array, Array]:
        """Which ends exist, and the ends with zero where there is none."""
        below, above = jnp.isfinite(self.lower), jnp.isfinite(self.upper)
        return below, above, jnp.where(below, self.lower, 0.0), jnp.where(above, self.upper, 0.0)

    def at_bound(self, values: Float[np.ndarray, " parameters"]) -> np.ndarray:
        """Whether a value has come to within 0.1 % of a user's two-sided range of one of its ends."""
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, np.inf)
        room = np.minimum(values - self.lower, self.upper - values)
        return np.isfinite(width) & (room < 1e-3 * width)


def build_transform(
    table: dict[str, Parameter],
    entries: Sequence[str],
    start: Float[np.ndarray, " parameters"],
    bounds: dict[str, tuple[float | None, float | None]],
) -> Transform:
    """The transform of the given entries: the table's domain narrowed by the user's bounds.

    **Raises:** `InputError` when a start value is not strictly inside its bounds.
    """
    lower, upper = [], []
    for entry, value in zip(entries, start, strict=True):
        low, high = bounds.get(entry, (None, None))
        floor = 0.0 if table_row(table, entry).positive else -np.inf
        lower.append(max(floor, -np.inf if low is None else low))
        upper.append(np.inf if high is None else high)
        if not lower[-1] < value < upper[-1]:
            raise InputError(
                f"the start value of '{entry}' must lie strictly between {lower[-1]:g} and {upper[-1]:g}, "
                f"but it is {value:g}; change the value or the bounds under [parameters], or hold it with fixed"
            )
    scale = np.where(start == 0, 1.0, np.abs(start))
    return Transform(np.asarray(lower), np.asarray(upper), scale)
