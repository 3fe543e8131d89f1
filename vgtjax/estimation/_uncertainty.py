"""What the data can tell: directions that change nothing, covariance, standard errors."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

NULL = 1e-9
"""Singular values below this part of the largest are no information: an exact Jacobian in double precision computes
a true null direction to about 1e-13, and the weakest real direction of these benches lies near 1e-4."""
NULL_SHARE = 1e-3
"""A parameter is unidentifiable when more than this share of it (squared) lies in null directions."""


@dataclasses.dataclass(frozen=True, eq=False)
class Uncertainty:
    """Linearised uncertainty of fitted parameters, all in the coordinates of the Jacobian.

    `covariance` is `(parameters, parameters)` with zeros for unidentifiable ones; `scale` is the factor
    `chi^2 / (degrees of freedom)` by which residuals exceed the assumed noise. `further_gain` is how much a full
    Gauss-Newton step would still lower chi^2 if the model were linear: far above one at the end of a fit, it says that
    kinks or weakly determined parameters have stopped it, and that the standard errors are only indicative.
    """

    covariance: Float[np.ndarray, "parameters parameters"]
    identifiable: Bool[np.ndarray, " parameters"]
    scale: float
    further_gain: float


def identifiable(columns: Float[np.ndarray, "residuals parameters"]) -> Bool[np.ndarray, " parameters"]:
    """Which parameters the data determine, from a Jacobian by parameters of comparable scale.

    Null directions are those of the Jacobian with columns of unit length, so that units don't matter. A column of
    zeros is one by itself.
    """
    lengths = np.linalg.norm(columns, axis=0)
    # A column this much shorter than the longest moves nothing that a sensor could see.
    alive = lengths > NULL * np.max(lengths, initial=0.0)
    known = alive.copy()
    if np.any(alive):
        _, singular, directions = np.linalg.svd(
            np.linalg.qr(columns[:, alive] / lengths[alive], mode="r"), full_matrices=False
        )
        null = directions[singular < NULL * singular[0]]
        known[alive] = np.sum(null**2, axis=0) <= NULL_SHARE
    return known


def estimate_uncertainty(
    residuals: Float[np.ndarray, " residuals"], columns: Float[np.ndarray, "residuals parameters"], count: int
) -> Uncertainty:
    """Covariance `s^2 (J^T J)^-1` at a least-squares minimum, by QR and a pseudo-inverse.

    Null directions take no part, and what the data do determine keeps the error that it has without them.

    **Arguments:** residuals in units of the assumed noise, their Jacobian, and the number of independent
    measurements (padding and eliminated offsets don't count).
    """
    known = identifiable(columns)
    covariance = np.zeros((columns.shape[1],) * 2)
    further_gain, rank = 0.0, 0
    lengths = np.linalg.norm(columns, axis=0)
    alive = lengths > 0
    if np.any(alive):
        basis, triangle = np.linalg.qr(columns[:, alive] / lengths[alive])
        rotation, singular, directions = np.linalg.svd(triangle)
        rank = int(np.sum(singular > NULL * singular[0]))
        further_gain = float(np.sum((rotation[:, :rank].T @ (basis.T @ residuals)) ** 2))
        inverse = directions[:rank].T / singular[:rank] / lengths[alive][:, None]
        covariance[np.ix_(alive, alive)] = inverse @ inverse.T
    scale = float(residuals @ residuals / max(count - rank, 1))
    covariance[~known], covariance[:, ~known] = 0.0, 0.0
    return Uncertainty(scale * covariance, known, scale, further_gain)
