"""Derivatives of every closed loop that remember as long as that is informative."""

import numpy as np
from jaxtyping import Float, Int

from ._problem import Linearisation, TuningProblem

SHAKING = 2.0
"""Highest standard error of a slope that is used as it is, in parts of the loop's cost. Many loops together average it
out, and what counts in the end is the simulated cost."""
CALM = 0.15 * SHAKING
"""Below this a loop may remember longer: between neighbouring memories errors differ by a factor of some ten."""
WILD = 10 * SHAKING
"""Above this a slope is shrunk by the ratio's square: the more it shakes, the less it says."""
SHARE = 0.25
"""Loops that shake and make up less than this part of the cost are not worth another linearisation."""
LINEARISATIONS = 3
"""At most, in one step."""
APART = 0.1
"""s; errors of tracking that lie further apart count as independent."""


def shaking(problem: TuningProblem, at: Linearisation) -> Float[np.ndarray, " cases"]:
    """Highest standard error of each loop's slopes in parts of its cost, infinite where they are not finite."""
    independent = (problem.cases.duration - problem.objective.settled) / APART
    steepest = np.max(np.einsum("cii->ci", at.curvatures), axis=1)
    with np.errstate(all="ignore"):
        errors = np.sqrt(2 * steepest / (max(independent, 1.0) * at.cases.costs))
    errors = np.where((steepest == 0) & (at.cases.costs == 0), 0.0, errors)  # nothing to shake
    return np.where(at.finite, errors, np.inf)


def linearise_remembered(
    problem: TuningProblem, coordinates: Float[np.ndarray, " gains"], memories: Int[np.ndarray, " cases"]
) -> tuple[Linearisation, Int[np.ndarray, " cases"], int]:
    """Derivatives that shake little, the memory that each loop may begin with next time, and how often all loops were
    linearised for that.

    Those of a loop that still shakes in the end count for less, and where they are not finite, the loop has no say.

    **Arguments:** `memories`: places in `problem.memories` that the loops begin with.
    """
    lengths, used = np.asarray(problem.memories), memories
    last, found = len(lengths) - 1, problem.linearise(coordinates, lengths[memories])
    error, asked = shaking(problem, found), 1
    for _ in range(LINEARISATIONS - 1):
        noisy = (error > SHAKING) & (used < last)
        if _share(problem, found, noisy) < SHARE:
            break
        used = np.minimum(used + _notches(error), last)
        again = problem.linearise(coordinates, lengths[used])
        asked += 1
        found = Linearisation(
            found.cases,
            np.where(noisy[:, None], again.slopes, found.slopes),
            np.where(noisy[:, None, None], again.curvatures, found.curvatures),
        )
        error = shaking(problem, found)
    calm = (error < CALM) & (used == memories)
    return _believed(found, error), np.clip(used + _notches(error) - calm, 0, last), asked


def _share(problem: TuningProblem, at: Linearisation, which: np.ndarray) -> float:
    """What some loops contribute to the cost, by its derivatives."""
    weights, _ = problem.objective.derivatives(at.cases.costs)
    parts = weights * at.cases.costs
    return float(np.sum(parts[which]) / max(np.sum(parts), np.finfo(float).tiny))


def _notches(error: Float[np.ndarray, " cases"]) -> Int[np.ndarray, " cases"]:
    """By how many places a memory is to be shorter."""
    return np.ceil(np.log10(np.clip(error / SHAKING, 1.0, 1e9))).astype(int)


def _believed(at: Linearisation, error: Float[np.ndarray, " cases"]) -> Linearisation:
    """Slopes of wild loops shrunk; where derivatives are not finite, zeros in their place."""
    trust = np.where(at.finite, np.minimum(1.0, (WILD / np.maximum(error, WILD)) ** 2), 0.0)
    slopes = trust[:, None] * np.where(at.finite[:, None], at.slopes, 0.0)
    return Linearisation(at.cases, slopes, np.where(at.finite[:, None, None], at.curvatures, 0.0))
