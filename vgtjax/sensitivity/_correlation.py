"""The thesis's sensitivity index: the squared correlation of an input with an output (section 4.1.2)."""

import numpy as np

from ._moments import Inputs, Outputs, Result, Weights, covariance, reciprocal, variance, weights_or_equal, with_members


def correlations(x: Inputs, y: Outputs, weights: Weights | None = None) -> Result:
    """Correlation coefficients of every input with every output.

    A constant input has the correlation 0, a constant output NaN: there is nothing to explain.

    **Arguments:** `x` and `y` of the same rows, of shape `(points, columns)`, or `(points, members, columns)` for rows
    that were drawn together, such as those of a base point; `weights` of the points, equal by default.
    """
    x, y = with_members(x), with_members(y)
    weights = weights_or_equal(weights, len(x))
    of_x = reciprocal(np.sqrt(variance(x, weights)), 0.0)
    of_y = reciprocal(np.sqrt(variance(y, weights)), np.nan)
    return covariance(y, x, weights) * of_y[..., :, None] * of_x[..., None, :]


def squared_correlation(x: Inputs, y: Outputs, weights: Weights | None = None) -> Result:
    """The index of (4.1), between 0 and 1, which the thesis calls SRC; arguments as those of [`correlations`][]."""
    return correlations(x, y, weights) ** 2
