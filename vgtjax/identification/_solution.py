"""Linear least squares with standard errors that say what is not determined."""

import dataclasses

import numpy as np
from jaxtyping import Float

RANK = 1e-6
"""Singular values below this part of the largest, with columns of unit length, are no information."""
NULL_SHARE = 1e-3
"""An unknown is undetermined when more than this share of it (squared) lies in null directions."""


@dataclasses.dataclass(frozen=True, eq=False)
class Solution:
    """`values` and their `std_errors`, NaN for what the equations do not determine."""

    values: Float[np.ndarray, " unknowns"]
    std_errors: Float[np.ndarray, " unknowns"]


def least_squares(matrix: Float[np.ndarray, "rows unknowns"], right: Float[np.ndarray, " rows"]) -> Solution:
    """Least-squares solution of equations whose rows are in units of their noise.

    Standard errors are those of white residuals of the size that is left, at least one.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    safe = np.where(lengths > 0, lengths, 1.0)
    left, singular, directions = np.linalg.svd(matrix / safe, full_matrices=False)
    rank = int(np.sum(singular > RANK * singular[0]))
    kept = directions[:rank].T / singular[:rank]
    values = kept @ (left[:, :rank].T @ right) / safe
    residual = right - matrix @ values
    scale = float(residual @ residual / max(len(right) - rank, 1))
    errors = np.sqrt(max(scale, 1.0) * np.sum(kept**2, axis=1)) / safe
    undetermined = (np.sum(directions[rank:] ** 2, axis=0) > NULL_SHARE) | (lengths == 0)
    return Solution(values, np.where(undetermined, np.nan, errors))


def white_noise(signal: Float[np.ndarray, " time"]) -> float:
    """Standard deviation of the white noise on a slow signal, in its unit (from third differences)."""
    scale = float(np.median(np.abs(np.diff(signal, n=3)))) / 0.6744897501960817 / np.sqrt(20.0)
    return max(scale, 1e-6 * float(np.max(np.abs(signal), initial=0.0)), 1e-12)
