"""A Gaussian process of the logarithm of the cost: what is learned from gains that were tried, without derivatives."""

import dataclasses

import numpy as np
import scipy
from jaxtyping import Float

ROUGH = 1e-3
"""Variance of what no smooth function explains, as a part of all: chance moves a cost by some percent."""
USUAL = 2.0
"""Distance over which costs are alike before anything is known, in the coordinates, where 0.7 doubles one gain."""
FIT_STEPS = 20
"""Of the distances' fit: what is learned grows by a batch at a time, and more would fit its chance."""


@dataclasses.dataclass(frozen=True, eq=False)
class Surrogate:
    """Mean and deviation of a function of which some values are known, by a Matérn kernel of order 5/2
    (Rasmussen and Williams, 2006, section 4.2), with a length for each coordinate; made by [`fit_surrogate`][].
    """

    points: Float[np.ndarray, "points gains"]
    lengths: Float[np.ndarray, " gains"]
    mean: float
    deviation: float
    root: Float[np.ndarray, "points points"]
    weights: Float[np.ndarray, " points"]

    def predict(
        self, at: Float[np.ndarray, "places gains"]
    ) -> tuple[Float[np.ndarray, " places"], Float[np.ndarray, "points places"]]:
        """Expected values, and columns whose squares add up to what the points tell of each, as a part of all."""
        likeness = kernel(at, self.points, self.lengths)
        told = scipy.linalg.solve_triangular(self.root, likeness.T, lower=True)
        return self.mean + likeness @ self.weights, told


def kernel(
    one: Float[np.ndarray, "ones gains"], other: Float[np.ndarray, "others gains"], lengths: Float[np.ndarray, " gains"]
) -> Float[np.ndarray, "ones others"]:
    """Correlation of the values at any two places."""
    away = np.sqrt(5 * np.sum(((one[:, None] - other[None]) / lengths) ** 2, axis=-1))
    return (1 + away + away**2 / 3) * np.exp(-away)


def fit_surrogate(points: Float[np.ndarray, "points gains"], values: Float[np.ndarray, " points"]) -> Surrogate:
    """The most probable lengths for these values, each within a factor of e or so of [`USUAL`][] beforehand."""
    centred = values - np.mean(values)
    squares = (points[:, None] - points[None]) ** 2
    start = np.full(points.shape[1], np.log(USUAL))
    found = scipy.optimize.minimize(
        lambda logs: _improbability(logs, squares, centred),
        start,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": FIT_STEPS},
    )
    lengths = np.exp(found.x)
    root = np.linalg.cholesky(kernel(points, points, lengths) + ROUGH * np.eye(len(points)))
    weights = scipy.linalg.cho_solve((root, True), centred)
    deviation = np.sqrt(max(centred @ weights / len(points), np.finfo(float).tiny))
    return Surrogate(points, lengths, float(np.mean(values)), float(deviation), root, weights)


def _improbability(
    logs: Float[np.ndarray, " gains"], squares: Float[np.ndarray, "points points gains"], values: np.ndarray
) -> tuple[float, Float[np.ndarray, " gains"]]:
    """Minus the logarithm of the likelihood at its best deviation, and of the prior; and its slope."""
    count, scaled = len(values), squares * np.exp(-2 * logs)
    away = np.sqrt(5 * scaled.sum(-1))
    fall = np.exp(-away)
    factor = scipy.linalg.cho_factor((1 + away + away**2 / 3) * fall + ROUGH * np.eye(count), lower=True)
    inverse = scipy.linalg.cho_solve(factor, np.eye(count))
    weights = inverse @ values
    variance = max(values @ weights / count, np.finfo(float).tiny)
    beside = logs - np.log(USUAL)
    steep = 0.5 * (inverse - np.outer(weights, weights) / variance) * (5 / 3) * (1 + away) * fall
    value = 0.5 * count * np.log(variance) + np.sum(np.log(np.diag(factor[0]))) + 0.5 * beside @ beside
    return float(value), np.einsum("ij,ijg->g", steep, scaled) + beside
