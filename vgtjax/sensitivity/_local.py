"""Sensitivity from exact derivatives: at one point, and over many."""

import math

import numpy as np
from jaxtyping import Float

from ._moments import reciprocal, weighted_mean, weights_or_equal

NORMAL = 1.0
"""Poincaré constant of a normal distribution in units of its variance."""
UNIFORM = 12.0 / math.pi**2
"""Poincaré constant of a uniform distribution in units of its variance."""


def gradient_share(
    gradients: Float[np.ndarray, "*outputs inputs"], deviations: Float[np.ndarray, " inputs"]
) -> Float[np.ndarray, "*outputs inputs"]:
    """Share of the variance of the model that is linear at one point, `(dy/dx_i s_i)^2 / sum_j (dy/dx_j s_j)^2`.

    An output whose gradient is zero gives NaN.

    **Arguments:** `gradients` in units of the output over units of the input; `deviations`: standard deviations of
    the inputs.
    """
    parts = (gradients * deviations) ** 2
    return parts * reciprocal(np.sum(parts, axis=-1, keepdims=True), np.nan)


def total_bound(
    gradients: Float[np.ndarray, "points outputs inputs"],
    deviations: Float[np.ndarray, " inputs"],
    variances: Float[np.ndarray, "*replicates outputs"],
    poincare: float | Float[np.ndarray, " inputs"],
    weights: Float[np.ndarray, "... points"] | None = None,
) -> Float[np.ndarray, "... outputs inputs"]:
    """Upper bound of the total index by derivatives, `C_i s_i^2 E((dy/dx_i)^2) / Var(y)` (Sobol' and Kucherenko, 2009).

    **Arguments:** `gradients` at points that are drawn from the inputs' distribution, which must be independent;
    `deviations`: standard deviations of the inputs; `variances` of the outputs, by all means from a larger sample;
    `poincare`: `C_i` for all inputs or for each; `weights` of the points, equal by default.
    """
    weights = weights_or_equal(weights, len(gradients))
    mean_square = weighted_mean(weights, gradients**2)
    return poincare * deviations**2 * mean_square * reciprocal(variances, np.nan)[..., :, None]
