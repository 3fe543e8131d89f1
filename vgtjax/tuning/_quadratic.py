"""The quadratic model of the cost of many closed loops, and its lowest point inside the conditions of the design."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float

from ._problem import Linearisation, TuningProblem

STEEPEST = 10.0
"""Highest curvature of a loop that is believed, in parts of its cost: this one doubles it within a factor of 1.6.
Where derivatives shake more than the cost does, as of a loop that hunts, Gauss and Newton's is far too high."""
FLOOR = 0.3
"""Part of the cost about which the model is no longer believed to fall as a parabola: that one may fall below zero."""


Kept = tuple[tuple[float, ...], float, tuple[float, ...], tuple[tuple[float, ...], ...]]
"""Place, cost, slope and curvature."""


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Gradient of `J`, and its Gauss-Newton curvature, at the coordinates `here`; made by [`model_at`][]."""

    here: Float[np.ndarray, " gains"]
    cost: float
    slope: Float[np.ndarray, " gains"]
    curvature: Float[np.ndarray, "gains gains"]

    def propose(self, problem: TuningProblem, radius: float) -> Float[np.ndarray, " gains"]:
        """The coordinates that it likes best within a distance of `radius`, the bounds and the conditions of the
        design, by SciPy's SLSQP."""
        here, transform = self.here, problem.transform
        bounds = np.stack([np.maximum(transform.lower - here, -radius), np.minimum(transform.upper - here, radius)], 1)
        ball = {"type": "ineq", "fun": lambda move: radius**2 - move @ move, "jac": lambda move: -2 * move}
        move = self._lowest(bounds, radius, [ball])
        if np.any(problem.conditions(here + move) < 0):
            conditions = {
                "type": "ineq",
                "fun": lambda move: problem.conditions(here + move),
                "jac": lambda move: problem.condition_slopes(here + move),
            }
            move = _inside(problem, here, self._lowest(bounds, radius, [ball, conditions]))
        return here + move

    def expected(self, places: Float[np.ndarray, "places gains"], highest: float) -> Float[np.ndarray, " places"]:
        """The logarithm of the cost there: the parabola's, which bends to zero about [`FLOOR`][] of the cost here, and
        differs from it by `highest` at most."""
        moves = places - self.here
        bent = 0.5 * np.einsum("pi,ij,pj->p", moves, self.curvature, moves)
        share = 1 + (moves @ self.slope + bent) / self.cost
        bent = np.maximum(FLOOR * np.logaddexp(share / FLOOR, 0.0), np.finfo(float).tiny)
        return np.log(self.cost) + np.clip(np.log(bent), -highest, highest)

    def kept(self) -> Kept:
        """As numbers and tuples."""
        curvature = tuple(map(tuple, self.curvature.tolist()))
        return tuple(self.here.tolist()), self.cost, tuple(self.slope.tolist()), curvature

    @classmethod
    def of(cls, kept: Kept) -> "QuadraticModel":
        """From what [`kept`][] has made of one."""
        here, cost, slope, curvature = kept
        return cls(np.asarray(here), cost, np.asarray(slope), np.asarray(curvature))

    def _lowest(
        self, bounds: Float[np.ndarray, "gains 2"], radius: float, constraints: Sequence[dict[str, Any]]
    ) -> Float[np.ndarray, " gains"]:
        slope, curvature = self.slope / self.cost, self.curvature / self.cost
        found = scipy.optimize.minimize(
            lambda move: slope @ move + 0.5 * move @ curvature @ move,
            np.zeros_like(self.here),
            jac=lambda move: slope + curvature @ move,
            method="SLSQP",
            bounds=bounds,
            constraints=constraints,
            options={"maxiter": 200, "ftol": 1e-10},
        )
        move = np.clip(found.x, *bounds.T)
        return move * min(1.0, radius / max(float(np.linalg.norm(move)), radius))


def model_at(problem: TuningProblem, coordinates: Float[np.ndarray, " gains"], at: Linearisation) -> QuadraticModel:
    """The model that Gauss and Newton's method makes of every closed loop's residuals (convex composite)."""
    weights, bends = problem.objective.derivatives(at.cases.costs)
    highest, tiny = np.linalg.eigvalsh(at.curvatures)[:, -1], np.finfo(float).tiny
    believed = np.minimum(1.0, STEEPEST * at.cases.costs / np.maximum(highest, tiny))
    curvature = np.einsum("c,cij->ij", weights * believed, at.curvatures) + at.slopes.T @ bends @ at.slopes
    return QuadraticModel(coordinates, problem.combine(at.cases.costs), weights @ at.slopes, curvature)


def _inside(
    problem: TuningProblem, here: Float[np.ndarray, " gains"], move: Float[np.ndarray, " gains"]
) -> Float[np.ndarray, " gains"]:
    """The step, shortened where rounding or a subproblem that was not solved took it outside."""
    for _ in range(30):
        if np.all(problem.conditions(here + move) >= 0):
            return move
        move = 0.5 * move
    return np.zeros_like(move)
