"""Gains to be tried next by what others cost, where derivatives say little."""

import numpy as np
from jaxtyping import Float

from ._problem import TuningProblem
from ._quadratic import QuadraticModel
from ._surrogate import ROUGH, Surrogate, fit_surrogate, kernel

NEAREST = 70
"""Gains that were tried and count: those nearest to the best."""
WORST = 4.0
"""Of the logarithm of a cost over the lowest; what costs more than e^4 times as much is only known to be bad."""
ALONG, AROUND, ALONE = 750, 450, 300
"""Gains that are thought of for each batch: where the quadratic model leads, around the best, and far along one of
them. The surrogate chooses."""
MOVED = 0.7
"""Part of the coordinates that each of those around the best moves."""
NEAR, WIDE = 0.15, 0.5
"""Standard deviations of those, in parts of the reach."""
LONGEST = 2.0
"""Of the reach, of a step of the quadratic model."""
BLURRED = 0.1
"""Of a move around the best, that each of those steps makes beside."""
STIFFEST, SOFTEST, UNEVEN = 3.0, -4.0, 2.0
"""Of the logarithms of the weights that shorten those steps: their ends for all gains together, in curvatures of the
logarithm of the cost, and the deviation of one gain's from those."""
FAR = 8.0
"""Of a move along one gain: one that acts by its reciprocal may do nothing until it is thousands of times as small."""
FARTHEST = 12.0
"""From the start, of all candidates: a gain that does nothing anywhere would drift without end."""
BOLDNESS = (0.0, 0.7, 1.0, 1.5)
"""Standard deviations by which the cost of each candidate of a batch is hoped to be lower than expected. The last of
them is far along one gain."""

Moves = Float[np.ndarray, "places gains"]


def scatter(
    problem: TuningProblem,
    tried: Float[np.ndarray, "tried gains"],
    costs: Float[np.ndarray, " tried"],
    reach: float,
    seed: int,
    model: QuadraticModel,
) -> Float[np.ndarray, "candidates gains"]:
    """A candidate for each of [`BOLDNESS`][] from the best that was tried, inside the conditions of the design.

    The surrogate is of what the logarithms of costs have beyond those that the quadratic model expects.

    **Arguments:** `costs`: infinite where a closed loop failed; `reach`: of most of them, in the coordinates; `model`:
    the last that derivatives gave.
    """
    rng, best = np.random.default_rng(seed), tried[np.argmin(costs)]
    near = np.argsort(np.sum((tried - best) ** 2, axis=1), kind="stable")[:NEAREST]
    logs = np.log(costs[near])
    beyond = np.minimum(logs, np.min(logs) + WORST) - model.expected(tried[near], WORST)
    surrogate = fit_surrogate(tried[near], beyond)
    moves = np.vstack(
        [
            _along(model, best, reach, rng) + BLURRED * _around(surrogate, reach, ALONG, rng),
            _around(surrogate, reach, AROUND, rng),
            _alone(len(best), rng),
        ]
    )
    places = np.vstack([best, np.clip(best + moves, *_ends(problem, best))])
    return _choose(problem, surrogate, places, model.expected(places, WORST))


def _ends(
    problem: TuningProblem, best: Float[np.ndarray, " gains"]
) -> tuple[Float[np.ndarray, " gains"], Float[np.ndarray, " gains"]]:
    """Least and largest of every candidate: the bounds, and [`FARTHEST`][] from the start, or where the best is."""
    lower = np.maximum(problem.transform.lower, np.minimum(problem.start - FARTHEST, best))
    return lower, np.minimum(problem.transform.upper, np.maximum(problem.start + FARTHEST, best))


def _along(model: QuadraticModel, best: Float[np.ndarray, " gains"], reach: float, rng: np.random.Generator) -> Moves:
    """Where the quadratic model leads, each by a distance of its own that weighs the gains: the model sees no cliff,
    and any of its valleys may be the one beside it."""
    curvature = model.curvature / model.cost
    slope = model.slope / model.cost + curvature @ (best - model.here)
    together = rng.uniform(SOFTEST, STIFFEST, size=(ALONG, 1))
    weights = np.exp(together + UNEVEN * rng.normal(size=(ALONG, len(best))))
    shortened = curvature[None] + np.eye(len(best)) * weights[:, None, :]
    moves = -np.linalg.solve(shortened, np.broadcast_to(slope[:, None], (ALONG, len(best), 1)))[..., 0]
    lengths = np.linalg.norm(moves, axis=1, keepdims=True)
    return moves * np.minimum(1.0, LONGEST * reach / np.maximum(lengths, np.finfo(float).tiny))


def _around(surrogate: Surrogate, reach: float, count: int, rng: np.random.Generator) -> Moves:
    """Around the best, further in gains along which costs are alike for longer (Eriksson et al., TuRBO, 2019)."""
    gains = surrogate.points.shape[1]
    apart = surrogate.lengths / np.exp(np.mean(np.log(surrogate.lengths)))
    drawn = rng.normal(size=(count, gains)) * (rng.random((count, gains)) < MOVED)
    return np.where(np.arange(count) % 2, WIDE, NEAR)[:, None] * reach * apart * drawn


def _alone(gains: int, rng: np.random.Generator) -> Moves:
    """Far along one gain each: of one that does nothing here neither derivatives nor costs nearby say where it does."""
    moves = np.zeros((ALONE, gains))
    moves[np.arange(ALONE), rng.integers(gains, size=ALONE)] = rng.uniform(-FAR, FAR, size=ALONE)
    return moves


def _choose(
    problem: TuningProblem,
    surrogate: Surrogate,
    places: Float[np.ndarray, "places gains"],
    beforehand: Float[np.ndarray, " places"],
) -> Float[np.ndarray, "candidates gains"]:
    """The places whose costs are hoped to be lowest; each makes those like it less uncertain for the next.

    The first of all places is inside the conditions, the last [`ALONE`][] are far along one gain. `beforehand` is what
    the surrogate's expectation adds to.
    """
    expected, told = surrogate.predict(places)
    unknown, chosen = np.maximum(1 - np.sum(told**2, axis=0), 1e-12), []
    far = np.arange(len(places)) >= len(places) - ALONE
    for number, boldness in enumerate(BOLDNESS, 1):
        hoped = beforehand + expected - boldness * surrogate.deviation * np.sqrt(unknown)
        hoped = np.where(far | (number < len(BOLDNESS)), hoped, np.inf)
        order = np.argsort(hoped, kind="stable")
        place = next(i for i in order if i == 0 or np.all(problem.conditions(places[i]) >= 0))
        chosen.append(place)
        alike = kernel(places, places[place][None], surrogate.lengths)[:, 0] - told.T @ told[:, place]
        column = alike / np.sqrt(unknown[place] + ROUGH)
        told, unknown = np.vstack([told, column]), np.maximum(unknown - column**2, 1e-12)
    return places[chosen]
