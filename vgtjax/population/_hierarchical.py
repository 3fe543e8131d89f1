"""Spread of units behind fitted values: freed of the errors of the fits."""

import numpy as np
from jaxtyping import Float

ITERATIONS = 1000
"""Of the expectation-maximisation below, whose last digits come slowly where a quantity hardly spreads."""

SETTLED = 1e-4
"""Change of a variance, in parts of what the units scatter by, below which a step is the last."""

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
    covariance = identity = np.eye(len(scale))
    # Whatever the covariance, so that the pseudo-inverse of each step below is an inverse in these directions.
    seen = _determined(np.linalg.solve(identity + weights, weights).sum(axis=0))
    for _ in range(ITERATIONS):
        # Given the covariance: the mean by generalised least squares, every unit by what it and the others tell.
        marginal = np.linalg.solve(identity + weights @ covariance, weights)
        error = seen @ np.linalg.solve(seen.T @ marginal.sum(axis=0) @ seen, seen.T)
        mean = error @ np.sum(_times(marginal, values), axis=0)
        moved = _times(marginal, values - mean) @ covariance
        left = covariance - covariance @ marginal @ covariance
        # The mean was estimated as well, and what that costs belongs to the covariance.
        shared = covariance @ marginal @ error @ marginal @ covariance
        before = covariance
        covariance = np.mean(moved[:, :, None] * moved[:, None, :] + left + shared, axis=0)
        covariance = 0.5 * (covariance + covariance.T)
        if np.max(np.abs(covariance - before)) < SETTLED:
            break
    return mean * scale, covariance * scale * scale[:, None]


def separate_each(
    found: Units, variances: Units
) -> tuple[Float[np.ndarray, " factors"], Float[np.ndarray, " factors"]]:
    """Mean and variance of every factor by itself, by the same model and method.

    With more factors than units the joint model can explain errors of one factor by the spread of others; what one
    factor's own values and errors say of its spread can't be fooled like that.

    **Arguments:** `variances` of each unit's errors, infinite for what it does not determine.
    """
    information = np.where(variances > 0, 1 / np.maximum(variances, 1e-300), 0.0)
    known = information > 0
    values = np.where(known, found, 0.0)
    errors = np.where(known, variances, np.inf)
    mean = np.sum(values * information, axis=0) / np.maximum(information.sum(axis=0), 1e-300)
    spread = np.sum(np.where(known, values - mean, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)
    for _ in range(ITERATIONS):
        weights = 1 / np.maximum(spread + errors, 1e-300)
        total = np.maximum(weights.sum(axis=0), 1e-300)
        mean = np.sum(weights * values, axis=0) / total
        moved = np.where(known, spread * weights * (values - mean), 0.0)
        spread = np.mean(moved**2 + spread - spread**2 * weights + (spread * weights) ** 2 / total, axis=0)
    return mean, spread


def _times(matrices: Matrices, vectors: Units) -> Units:
    """The product of each unit's matrix and vector."""
    return (matrices @ vectors[:, :, None])[:, :, 0]


def _determined(information: Matrix) -> Float[np.ndarray, "factors directions"]:
    """Directions that some unit determines."""
    sizes, directions = np.linalg.eigh(information)
    return directions[:, sizes > len(sizes) * np.finfo(float).eps * sizes[-1]]


def _sizes(found: Units, precisions: Matrices) -> Float[np.ndarray, " factors"]:
    """A usual size of what is between units, for equations that are well scaled."""
    information = np.einsum("uii->ui", precisions)
    known = information > 0
    counts = np.maximum(known.sum(axis=0), 1)
    centre = np.sum(np.where(known, found, 0.0), axis=0) / counts
    deviation = np.sqrt(np.sum(np.where(known, found - centre, 0.0) ** 2, axis=0) / counts)
    error = 1 / np.sqrt(np.maximum(information.sum(axis=0) / counts, 1e-300))
    return np.maximum(deviation, np.where(np.any(known, axis=0), error, 1.0))
