"""Derivatives of every closed loop that remember as long as they tell something."""

import numpy as np
from jaxtyping import Float, Int

from .problem import Linearisation, Problem

SHAKING = 5.0
"""Highest standard error of a slope that is used, in parts of the loop's cost. Many loops together average it out, and
a step counts only if the simulated cost falls."""
CALM = SHAKING / 10
"""Below this a loop may remember longer: between neighbouring memories errors differ by a factor of some ten."""
WILD, FEW = 10 * SHAKING, 0.25
"""Where so few loops shake, none of them wildly, their slopes are used this once."""
APART = 0.1
"""s; errors of tracking that lie further apart count as independent."""


def shaking(
    problem: Problem, at: Linearisation, coordinates: Float[np.ndarray, " gains"]
) -> Float[np.ndarray, " cases"]:
    """Standard error of each loop's slopes in parts of its cost, infinite where they are not finite.

    A slope is twice the sum of residuals times their derivatives. Where the derivatives are those of chaos, they have
    nothing to do with the residuals, and a sum of `N` independent products has the variance `2 l H / N`, `H` from the
    curvature that Gauss and Newton's method would use. Of all gains that may move the upper quartile counts.
    """
    transform, independent = problem.transform, (problem.cases.duration - problem.objective.settled) / APART
    inside = (coordinates > transform.lower + 1e-3) & (coordinates < transform.upper - 1e-3)
    diagonals = np.einsum("cii->ci", at.curvatures)[:, inside if np.any(inside) else slice(None)]
    with np.errstate(all="ignore"):
        errors = np.sqrt(2 * np.quantile(diagonals, 0.75, axis=1) / (max(independent, 1.0) * at.cases.costs))
    return np.where(at.finite, errors, np.inf)


def linearise_remembered(
    problem: Problem, coordinates: Float[np.ndarray, " gains"], memories: Int[np.ndarray, " cases"]
) -> tuple[Linearisation, Int[np.ndarray, " cases"]]:
    """Derivatives that shake little, and the memory that each loop may begin with next time.

    Those of a loop that still shakes with the shortest memory are used nevertheless, unless they are not finite: then
    the loop has no say.

    **Arguments:** `memories`: places in `problem.memories` that the loops begin with.
    """
    lengths, used = np.asarray(problem.memories), memories.copy()
    found, last = problem.linearise(coordinates, lengths[used]), len(lengths) - 1
    error = shaking(problem, found, coordinates)
    while np.any(noisy := (error > SHAKING) & (used < last)):
        if np.mean(noisy) < FEW and np.max(error) < WILD:
            break
        used = used + noisy
        again = problem.linearise(coordinates, lengths[used])
        found = Linearisation(
            found.cases,
            np.where(noisy[:, None], again.slopes, found.slopes),
            np.where(noisy[:, None, None], again.curvatures, found.curvatures),
        )
        error = shaking(problem, found, coordinates)
    mute = ~found.finite
    found = Linearisation(
        found.cases, np.where(mute[:, None], 0.0, found.slopes), np.where(mute[:, None, None], 0.0, found.curvatures)
    )
    calm = (error < CALM) & (used == memories)
    return found, np.clip(used + (error > SHAKING) - calm, 0, last)
