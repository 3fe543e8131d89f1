"""Variance-based indices: what an input explains alone, and together with others."""

import numpy as np
from jaxtyping import Float

from ._moments import Result, Weights, reciprocal, variance, weighted_mean, weights_or_equal

Outputs = Float[np.ndarray, "base outputs"]
Radial = Float[np.ndarray, "base inputs outputs"]


def first_order(a: Outputs, ab: Radial, b: Outputs, weights: Weights | None = None) -> Result:
    """First-order index `Var(E(y | x_i)) / Var(y)` by Saltelli et al. (2010), table 2 (b).

    Outputs are centred with the mean over `a` and `b`, whose pooled variance (4.2) is also the denominator. The
    estimator may be slightly negative. A constant output gives NaN.

    **Arguments:** outputs at the points A, AB and B of a radial design; `weights` of the base points, equal by default.
    """
    weights = weights_or_equal(weights, len(a))
    gap = ab - a[:, None, :]
    # Without the centre, b times gap would lose the digits that matter, and have more variance than it needs.
    centre = np.mean(a + b, axis=0) / 2
    together = weighted_mean(weights, (b - centre)[:, None, :] * gap)
    shift = weighted_mean(weights, (a + b) / 2 - centre)
    return _share(together - shift[..., None, :] * weighted_mean(weights, gap), a, b, weights)


def total_order(a: Outputs, ab: Radial, b: Outputs, weights: Weights | None = None) -> Result:
    """Total index `E(Var(y | all but x_i)) / Var(y)` by Jansen (1999); arguments as those of [`first_order`][].

    It is never negative, and exactly zero for an input that does nothing.
    """
    weights = weights_or_equal(weights, len(a))
    gap = ab - a[:, None, :]
    return _share(weighted_mean(weights, gap**2) / 2, a, b, weights)


def _share(part: Float[np.ndarray, "*replicates inputs outputs"], a: Outputs, b: Outputs, weights: Weights) -> Result:
    whole = variance(np.stack([a, b], axis=1), weights)
    return np.swapaxes(part, -1, -2) * reciprocal(whole, np.nan)[..., None]
