"""Gains to be tried next by what others cost, where derivatives say little."""

import numpy as np
from jaxtyping import Float

from ._problem import TuningProblem
from ._surrogate import ROUGH, Surrogate, fit_surrogate, kernel

NEAREST = 70
"""Gains that were tried and count: those nearest to the best."""
WORST = 4.0
"""Of the logarithm of a cost over the lowest; what costs more than e^4 times as much is only known to be bad."""
DRAWN = 1500
"""Gains that are thought of for each batch."""
MOVED = 0.7
"""Part of the coordinates that each of them moves."""
BOLDNESS = (0.0, 0.7, 1.0, 1.5)
"""Standard deviations by which the cost of each candidate of a batch is hoped to be lower than expected."""


def scatter(
    problem: TuningProblem,
    tried: Float[np.ndarray, "tried gains"],
    costs: Float[np.ndarray, " tried"],
    reach: float,
    seed: int,
) -> Float[np.ndarray, "candidates gains"]:
    """A candidate for each of [`BOLDNESS`][] around the best that was tried, inside the conditions of the design.

    **Arguments:** `costs`: infinite where a closed loop failed; `reach`: of most of them, in the coordinates.
    """
    rng, best = np.random.default_rng(seed), tried[np.argmin(costs)]
    near = np.argsort(np.sum((tried - best) ** 2, axis=1), kind="stable")[:NEAREST]
    logs = np.log(costs[near])
    surrogate = fit_surrogate(tried[near], np.minimum(logs, np.min(logs) + WORST))
    drawn = rng.normal(size=(DRAWN, len(best))) * (rng.random((DRAWN, len(best))) < MOVED)
    sizes = np.where(np.arange(DRAWN) % 2, 0.5, 0.15)[:, None] * reach
    places = np.clip(best + sizes * drawn, problem.transform.lower, problem.transform.upper)
    return _choose(problem, surrogate, np.vstack([best, places]))


def _choose(
    problem: TuningProblem, surrogate: Surrogate, places: Float[np.ndarray, "places gains"]
) -> Float[np.ndarray, "candidates gains"]:
    """The places whose costs are hoped to be lowest; each makes those like it less uncertain for the next.

    The first of all places is inside the conditions.
    """
    expected, told = surrogate.predict(places)
    unknown, chosen = np.maximum(1 - np.sum(told**2, axis=0), 1e-12), []
    for boldness in BOLDNESS:
        hoped = expected - boldness * surrogate.deviation * np.sqrt(unknown)
        order = np.argsort(hoped, kind="stable")
        place = next(i for i in order if i == 0 or np.all(problem.conditions(places[i]) >= 0))
        chosen.append(place)
        alike = kernel(places, places[place][None], surrogate.lengths)[:, 0] - told.T @ told[:, place]
        column = alike / np.sqrt(unknown[place] + ROUGH)
        told, unknown = np.vstack([told, column]), np.maximum(unknown - column**2, 1e-12)
    return places[chosen]
