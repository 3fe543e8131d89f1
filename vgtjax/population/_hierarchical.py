"""Spread of units behind fitted values: freed of the errors of the fits."""

import numpy as np
from jaxtyping import Float

ITERATIONS = 1000
"""Of the expectation-maximisation below, whose last digits come slowly where a quantity hardly spreads."""

Units = Float[np.ndarray, "units factors"]
Matrices = Float[np.ndarray, "units factors factors"]
Matrix = Float[np.ndarray, "factors factors"]


def separate(found: Units, precisions: Matrices) -> tuple[Float[np.ndarray, " factors"], Matrix]:
    """Mean and covariance of units of which each was found with a known error.

    The hierarchical normal model `x ~ N(mean, covariance)`, `found ~ N(x, inverse of precision)` by restricted maximum
    likelihood, with expectation-maximisation (Laird and Ware, 1982). What no unit determines neither moves nor spreads.

    **Arguments:** `precisions`: inverse covariance of each unit's errors, in the units of `found`; zero for what a unit
    does not determine, whose value then does not matter.
    """
    scale = _sizes(found, precisions)
    values, weights = found / scale, precisions * scale * scale[:, None]
    total = np.linalg.pinv(weights.sum(axis=0), hermitian=True)
    mean = total @ np.einsum("uij,uj->i", weights, values)
    covariance = np.eye(len(scale))
    identity = np.eye(len(scale))
    for _ in range(ITERATIONS):
        # Given the covariance: the mean by generalised least squares, every unit by what it and the others tell.
        marginal = np.linalg.solve(identity + weights @ covariance, weights)
        error = np.linalg.pinv(marginal.sum(axis=0), hermitian=True)
        mean = error @ np.einsum("uij,uj->i", marginal, values)
        moved = np.einsum("ij,ujk,uk->ui", covariance, marginal, values - mean)
        left = covariance - covariance @ marginal @ covariance
        # The mean was estimated as well, and what that costs belongs to the covariance.
        shared = covariance @ marginal @ error @ marginal @ covariance
        covariance = np.mean(moved[:, :, None] * moved[:, None, :] + left + shared, axis=0)
        covariance = 0.5 * (covariance + covariance.T)
    return mean * scale, covariance * scale * scale[:, None]


def _sizes(found: Units, precisions: Matrices) -> Float[np.ndarray, " factors"]:
    """A usual size of what is between units, for equations that are well scaled."""
    information = np.einsum("uii->ui", precisions)
    known = information > 0
    counts = np.maximum(known.sum(axis=0), 1)
    centre = np.sum(np.where(known, found, 0.0), axis=0) / counts
    deviation = np.sqrt(np.sum(np.where(known, found - centre, 0.0) ** 2, axis=0) / counts)
    error = 1 / np.sqrt(np.maximum(information.sum(axis=0) / counts, 1e-300))
    return np.maximum(deviation, np.where(np.any(known, axis=0), error, 1.0))
