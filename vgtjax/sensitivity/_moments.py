"""Weighted means over the independent points of a sample, on which every index and its bootstrap is built."""

import numpy as np
from jaxtyping import Float

Weights = Float[np.ndarray, "*replicates points"]
Values = Float[np.ndarray, "points ..."]
Inputs = Float[np.ndarray, "points *members inputs"]
Outputs = Float[np.ndarray, "points *members outputs"]
Result = Float[np.ndarray, "*replicates outputs inputs"]
"""One number for every input of every output; of a bootstrap, for each of its replicates."""

CONSTANT = 1e-12
"""A column whose standard deviation is below this part of its largest value is constant but for rounding."""
_CHUNK = 2**21
"""Numbers in a temporary array of products: 16 MiB."""


def weights_or_equal(weights: Weights | None, points: int) -> Weights:
    """The given weights, or equal ones; weights of one replicate sum to one."""
    return np.full(points, 1.0 / points) if weights is None else weights


def weighted_mean(weights: Weights, values: Values) -> Float[np.ndarray, "..."]:
    """Mean over the points, as one matrix product for all replicates and columns."""
    return np.tensordot(weights, values, axes=1)


def with_members(values: np.ndarray) -> Float[np.ndarray, "points members columns"]:
    """Rows that were drawn one by one as groups of one; rows that were drawn together have their groups already."""
    return values[:, None, :] if values.ndim == 2 else values


def centred(values: Float[np.ndarray, "points members columns"]) -> Float[np.ndarray, "points members columns"]:
    """Without the mean of each column, so that second moments lose no digits."""
    return values - values.mean(axis=(0, 1))


def covariance(
    left: Float[np.ndarray, "points members p"], right: Float[np.ndarray, "points members q"], weights: Weights
) -> Float[np.ndarray, "*replicates p q"]:
    """Weighted covariance of every column on the left with every one on the right; members share a point's weight."""
    left, right = centred(left), centred(right)
    points, members, columns = left.shape
    total = np.zeros((*weights.shape[:-1], columns, right.shape[2]))
    step = max(1, _CHUNK // max(columns * right.shape[2], 1))
    for begin in range(0, points, step):
        part = slice(begin, begin + step)
        products = np.swapaxes(left[part], 1, 2) @ right[part] / members
        total += weighted_mean(weights[..., part], products)
    means = [weighted_mean(weights, side.mean(axis=1)) for side in (left, right)]
    return total - means[0][..., :, None] * means[1][..., None, :]


def variance(values: Values, weights: Weights | None = None) -> Float[np.ndarray, "*replicates columns"]:
    """Variance of every column by (4.2), that is, divided by the number of rows.

    A column that is constant but for rounding has none at all.

    **Arguments:** `values` of shape `(points, columns)`, or `(points, members, columns)` for rows that were drawn
    together; `weights` of the points, of shape `(points,)` or `(replicates, points)`, equal by default.
    """
    values = with_members(values)
    weights = weights_or_equal(weights, len(values))
    deviations = centred(values)
    spread = weighted_mean(weights, np.mean(deviations**2, axis=1))
    spread = spread - weighted_mean(weights, deviations.mean(axis=1)) ** 2
    rounding = (CONSTANT * np.max(np.abs(values), axis=(0, 1))) ** 2
    return np.where(spread <= rounding, 0.0, spread)


def reciprocal(values: np.ndarray, of_zero: float) -> np.ndarray:
    """`1 / values`, and a given number instead where they are zero; NaN stays NaN."""
    return np.where(values == 0.0, of_zero, 1.0 / np.where(values == 0.0, 1.0, values))
