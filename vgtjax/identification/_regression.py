"""Least squares whose errors don't believe that neighbouring samples are independent."""

import numpy as np
from jaxtyping import Bool, Float, Int

Columns = Float[np.ndarray, "residuals parameters"]


def inverse_gram(columns: Columns) -> Float[np.ndarray, "parameters parameters"]:
    """`(J^T J)^-1` by a pseudo-inverse with columns of unit length; null directions have no variance."""
    lengths = np.linalg.norm(columns, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    inverse = np.linalg.pinv(columns / lengths, rcond=1e-10) / lengths[:, None]
    return inverse @ inverse.T


def clustered_errors(
    residuals: Float[np.ndarray, " residuals"], columns: Columns, groups: Int[np.ndarray, " residuals"]
) -> Float[np.ndarray, " parameters"]:
    """Standard errors of a least-squares solution whose residuals are correlated among neighbours.

    The larger of two: from sums over groups of neighbours (Liang and Zeger, 1986), which believes nothing but that
    groups are independent, and misses what few groups tell; and the usual one, multiplied by how much the sum of a
    group varies more than that of independent residuals.
    """
    bread = inverse_gram(columns)
    members = np.unique(groups, return_inverse=True)[1]
    count = int(members.max()) + 1
    scores = np.zeros((count, columns.shape[1]))
    np.add.at(scores, members, columns * residuals[:, None])
    few = count / max(count - columns.shape[1], 1)
    robust = few * np.diag(bread @ (scores.T @ scores) @ bread)
    sums = np.bincount(members, residuals)
    together = max(1.0, float(np.sum(sums**2) / max(np.sum(residuals**2), 1e-300)))
    freedom = max(np.count_nonzero(residuals) - columns.shape[1], 1)
    usual = together * float(np.sum(residuals**2)) / freedom * np.diag(bread)
    return np.sqrt(np.maximum(robust, usual))


def usual_factor(columns: Columns, errors: Float[np.ndarray, " parameters"]) -> float:
    """By how much standard errors exceed those of residuals of size one that are independent, in the median."""
    usual = np.sqrt(np.diag(inverse_gram(columns)))
    return float(np.median(errors[usual > 0] / usual[usual > 0])) if np.any(usual > 0) else 1.0


def determined(columns: Columns, scale: float, worst: float) -> Bool[np.ndarray, " parameters"]:
    """Which parameters can be told, if those that can't are held one after the other, the least certain first.

    **Arguments:** `columns` by parameters in comparable units, such as logarithms; `scale` multiplies their standard
    errors; `worst` is the largest that still counts as told.
    """
    free = np.linalg.norm(columns, axis=0) > 0
    while np.any(free):
        chosen = np.flatnonzero(free)
        gram = columns[:, chosen].T @ columns[:, chosen]
        lengths = np.sqrt(np.diag(gram))
        values, vectors = np.linalg.eigh(gram / np.outer(lengths, lengths))
        # A direction of no information at all has no variance in a pseudo-inverse; here it must have a huge one.
        variances = (vectors**2 / np.maximum(values, 1e-13)).sum(axis=1) / lengths**2
        least = int(np.argmax(variances))
        if scale * np.sqrt(variances[least]) <= worst:
            break
        free[chosen[least]] = False
    return free
