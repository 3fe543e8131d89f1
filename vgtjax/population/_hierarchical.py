"""Spread of units behind fitted values: freed of the errors of the fits."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

ROUNDS = 500
"""Of two steps of the expectation-maximisation below and one beyond them. In twenty units with errors ten times their
spread plain steps of 1e-4 in a row end at 1.6 times the spread that is likeliest."""

SETTLED = 1e-7
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
    identity = np.eye(len(scale))
    # One unit's value, or none, says nothing of a spread.
    several = np.sum(np.einsum("uii->ui", weights) > 0, axis=0) > 1
    # Whatever the covariance, so that the pseudo-inverse of each step below is an inverse in these directions.
    seen = _determined(np.linalg.solve(identity + weights, weights).sum(axis=0))

    def mean_for(covariance: Matrix) -> tuple[np.ndarray, Matrices, Matrix]:
        """The mean by generalised least squares, the units' precisions about it, and its own covariance."""
        marginal = np.linalg.solve(identity + weights @ covariance, weights)
        error = seen @ np.linalg.solve(seen.T @ marginal.sum(axis=0) @ seen, seen.T)
        return error @ np.sum(_times(marginal, values), axis=0), marginal, error

    def step(covariance: Matrix) -> Matrix:
        """Every unit by what it and the others tell, given the covariance, and the covariance of these."""
        mean, marginal, error = mean_for(covariance)
        moved = _times(marginal, values - mean) @ covariance
        left = covariance - covariance @ marginal @ covariance
        # The mean was estimated as well, and what that costs belongs to the covariance.
        shared = covariance @ marginal @ error @ marginal @ covariance
        found = np.mean(moved[:, :, None] * moved[:, None, :] + left + shared, axis=0)
        return 0.5 * (found + found.T)

    covariance = _settle(step, np.diag(several.astype(float)), _is_covariance)
    mean = mean_for(covariance)[0]
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
    several = known.sum(axis=0) > 1

    def mean_for(spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The mean, the weights of the units, and their sum."""
        weights = 1 / np.maximum(spread + errors, 1e-300)
        total = np.maximum(weights.sum(axis=0), 1e-300)
        return np.sum(weights * values, axis=0) / total, weights, total

    mean = np.sum(values * information, axis=0) / np.maximum(information.sum(axis=0), 1e-300)
    scatter = np.sum(np.where(known, values - mean, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)
    scale = np.where(scatter > 0, scatter, 1.0)

    def step(part: np.ndarray) -> np.ndarray:
        spread = part * scale
        mean, weights, total = mean_for(spread)
        moved = np.where(known, spread * weights * (values - mean), 0.0)
        return np.mean(moved**2 + spread - spread**2 * weights + (spread * weights) ** 2 / total, axis=0) / scale

    part = _settle(step, np.where(several & (scatter > 0), 1.0, 0.0), lambda part: bool(np.all(part >= 0)))
    return mean_for(part * scale)[0], part * scale


def _settle(
    step: Callable[[np.ndarray], np.ndarray], begin: np.ndarray, possible: Callable[[np.ndarray], bool]
) -> np.ndarray:
    """Where steps of an expectation-maximisation settle, whose last digits come slowly where a quantity hardly spreads.

    Two steps tell how they shrink, and how far they would lead (SQUAREM, Varadhan and Roland, 2008); where what is
    beyond is not `possible`, they count alone.
    """
    at = begin
    for _ in range(ROUNDS):
        first = step(at)
        second = step(first)
        move, bend = first - at, second - 2 * first + at
        if np.max(np.abs(second - first), initial=0.0) < SETTLED:
            return second
        far = max(1.0, float(np.linalg.norm(move)) / max(float(np.linalg.norm(bend)), 1e-300))
        beyond = at + 2 * far * move + far**2 * bend
        at = step(beyond) if possible(beyond) else second
    return at


def _is_covariance(matrix: Matrix) -> bool:
    """Whether no direction has a negative variance, but for rounding."""
    return bool(np.min(np.linalg.eigvalsh(matrix), initial=0.0) >= -1e-12)


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
