"""Interpolation in measured tables."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Knots, Values


def _ramps(knots: Knots, at: Values) -> list[Values]:
    """How far `at` has crossed each interval of increasing `knots`, from 0 to 1."""
    count = knots.shape[0]
    return [jnp.clip((at - knots[k]) / (knots[k + 1] - knots[k]), 0.0, 1.0) for k in range(count - 1)]


def _along(values: Sequence[Values], ramps: Sequence[Values]) -> Values:
    total = values[0]
    for low, high, ramp in zip(values[:-1], values[1:], ramps, strict=True):
        total = total + (high - low) * ramp
    return total


def bilinear(
    rows: Knots, columns: Knots, values: Float[Array | np.ndarray, "rows columns"], row: Values, column: Values
) -> Values:
    """Value of a table at `(row, column)`, linear between its increasing knots and held beyond them.

    Continuous, with kinks at the knots.
    """
    # A sum over intervals instead of a look-up: tables are small, and a gather inside a march is slow.
    over_columns = _ramps(columns, column)
    by_row = [_along([values[i, j] for j in range(values.shape[1])], over_columns) for i in range(values.shape[0])]
    return _along(by_row, _ramps(rows, row))
