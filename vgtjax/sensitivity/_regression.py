"""Standardised regression: signed coefficients of a linear model, and how much of the output that explains.

Through covariances, as thousands of bootstrap replicates of one sample are solved in a few matrix products; all else
is solved by `vgtjax.estimation.least_squares`.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._moments import Inputs, Outputs, Result, Weights, covariance, reciprocal, variance, weights_or_equal, with_members

RANK = 1e-10
"""Eigenvalues of the inputs' correlation matrix below this part of the largest are no direction of their own; rounding
makes about 1e-15 of the zero of an input that others determine."""
RIDGE = 1e-12
"""Added to a matrix that is the identity but for resampling: a replicate with fewer points than inputs has a solution,
and any other loses nothing."""


@dataclasses.dataclass(frozen=True, eq=False)
class Regression:
    """A least-squares linear model of every output.

    `coefficients` `(*replicates, outputs, inputs)` are in standard deviations of the output per standard deviation of
    the input; `r2` and `adjusted_r2` `(*replicates, outputs)` say how much of the variance the model explains.
    """

    coefficients: Result
    r2: Float[np.ndarray, "*replicates outputs"]
    adjusted_r2: Float[np.ndarray, "*replicates outputs"]


def regress(x: Inputs, y: Outputs, weights: Weights | None = None) -> Regression:
    """Fits a linear model with constant term to every output (Saltelli et al., 2008, section 1.2.5).

    Inputs may be correlated. A constant input has the coefficient 0. Inputs that determine each other share their
    effect in the smallest way (pseudo-inverse). A constant output gives NaN. `adjusted_r2` counts every point once,
    however many rows were drawn together, and is NaN when there are no more points than unknowns.

    **Arguments:** as those of [`correlations`][vgtjax.sensitivity.correlations].
    """
    x, y = with_members(x), with_members(y)
    weights = weights_or_equal(weights, len(x))
    basis = _independent_directions(x)
    directions = (x - x.mean(axis=(0, 1))) @ basis
    among = covariance(directions, directions, weights) + RIDGE * np.eye(basis.shape[1])
    with_output = covariance(directions, y, weights)
    slopes = np.linalg.solve(among, with_output)
    of_y = reciprocal(np.sqrt(variance(y, weights)), np.nan)
    scale = np.sqrt(variance(x, weights))[..., :, None] * of_y[..., None, :]
    coefficients = np.swapaxes(basis @ slopes * scale, -1, -2)
    r2 = np.sum(slopes * with_output, axis=-2) * of_y**2
    freedom = len(x) - 1 - basis.shape[1]
    unexplained = (1 - r2) * ((len(x) - 1) / freedom if freedom > 0 else np.nan)
    return Regression(coefficients, r2, 1 - unexplained)


def _independent_directions(x: Float[np.ndarray, "points members inputs"]) -> Float[np.ndarray, "inputs directions"]:
    """Combinations of the inputs that are uncorrelated and of variance one over the whole sample.

    Decided once, for all replicates; in these directions each of them has a matrix close to the identity.
    """
    scale = reciprocal(np.sqrt(variance(x)), 0.0)
    scaled = (x - x.mean(axis=(0, 1))) * scale
    values, vectors = np.linalg.eigh(covariance(scaled, scaled, weights_or_equal(None, len(x))))
    known = values > RANK * np.max(values, initial=0.0)
    return scale[:, None] * vectors[:, known] / np.sqrt(values[known])
