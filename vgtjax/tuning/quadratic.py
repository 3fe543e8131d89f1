"""The quadratic model of the cost of many closed loops, and its lowest point inside the conditions of the design."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Float

from .problem import Linearisation, Problem

TRUSTED = 1e-3
"""Below this damping the curvature is taken in proportion to it. Where derivatives shake more than the cost does, as
of a loop that hunts, Gauss and Newton's curvature is far too high, and steps that gain more than it promised say so."""


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Gradient of `J`, and its Gauss-Newton curvature, at the coordinates `here`; made by [`model_at`][]."""

    here: Float[np.ndarray, " gains"]
    cost: float
    slope: Float[np.ndarray, " gains"]
    curvature: Float[np.ndarray, "gains gains"]

    def propose(self, problem: Problem, damping: float, radius: float) -> Float[np.ndarray, " gains"]:
        """The coordinates that it likes best, damped as by Levenberg and Marquardt, no coordinate moved by more than
        `radius`, within the bounds and the conditions of the design, by SciPy's SLSQP."""
        here, curvature = self.here, min(1.0, damping / TRUSTED) * self.curvature
        scale = np.maximum(np.diag(curvature), 1e-3 * np.max(np.diag(curvature)) + np.finfo(float).tiny)
        damped, transform = curvature + damping * np.diag(scale), problem.transform
        low = np.maximum(transform.lower - here, -radius)
        high = np.minimum(transform.upper - here, radius)
        move = self._lowest(damped, low, high)
        if np.any(problem.conditions(here + move) < 0):
            conditions = {
                "type": "ineq",
                "fun": lambda move: problem.conditions(here + move),
                "jac": lambda move: problem.condition_slopes(here + move),
            }
            move = _inside(problem, here, self._lowest(damped, low, high, [conditions]))
        return here + move

    def _lowest(
        self,
        curvature: Float[np.ndarray, "gains gains"],
        low: Float[np.ndarray, " gains"],
        high: Float[np.ndarray, " gains"],
        conditions: Sequence[dict[str, Any]] = (),
    ) -> Float[np.ndarray, " gains"]:
        found = scipy.optimize.minimize(
            lambda move: (self.slope @ move + 0.5 * move @ curvature @ move) / self.cost,
            np.zeros_like(self.here),
            jac=lambda move: (self.slope + curvature @ move) / self.cost,
            method="SLSQP",
            bounds=np.stack([low, high], 1),
            constraints=conditions,
            options={"maxiter": 200, "ftol": 1e-10},
        )
        return np.clip(found.x, low, high)


def model_at(problem: Problem, coordinates: Float[np.ndarray, " gains"], at: Linearisation) -> QuadraticModel:
    """The model that Gauss and Newton's method makes of every closed loop's residuals (convex composite).

    With `J = A(l_1, l_2, ...)` and `A` convex and rising, `H = sum dA/dl_i H_i + L^T A'' L` is never negative, where
    `H_i` is twice the Gram matrix of the residuals' derivatives and `L` holds the slopes of `l_i`.
    """
    weights, bends = problem.objective.derivatives(at.cases.costs)
    curvature = np.einsum("c,cij->ij", weights, at.curvatures) + at.slopes.T @ bends @ at.slopes
    return QuadraticModel(coordinates, problem.combine(at.cases.costs), weights @ at.slopes, curvature)


def _inside(
    problem: Problem, here: Float[np.ndarray, " gains"], move: Float[np.ndarray, " gains"]
) -> Float[np.ndarray, " gains"]:
    """The step, shortened where rounding or a subproblem that was not solved took it outside."""
    for _ in range(30):
        if np.all(problem.conditions(here + move) >= 0):
            return move
        move = 0.5 * move
    return np.zeros_like(move)
