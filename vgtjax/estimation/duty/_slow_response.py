"""How the sharp model answers along what slow traces tell, of which derivatives of the smooth one promise more.

A plunger that a slow duty carries to its seat chatters there, and a derivative has how the phase of that moves, which
in thousands of samples looks like information. `docs/estimation.md` ("What derivatives of slow traces promise") has how
far off that was, and what becomes of an error.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..._types import Coordinates
from .._least_squares import LeastSquares, finite_columns, root_of
from ..derivatives import Computation, lengthens, side_by_side
from ..search import AbstractCalibrator
from ._answers import Combinations, answers_beside, holding

TOLD = 0.01
"""Standard error of a logarithm up to which its own direction is not asked: what a hovering plunger seems to tell is
weaker."""
MOST, NEAREST = 4.0, 0.1
"""Standard errors by which an end is moved to either side, at most and at least. The sharp model's chatter makes the
answer to a move of one standard error uncertain by a half, that to four by a tenth."""
NEW = 0.3
"""Part of a direction's square that those before it do not have, at least, for it to be asked."""
NONE, LEAST = 0.25, 0.02
"""Answer below which there is none, and what counts for that in values that lie along the direction by `MOSTLY`: an
error of two percent is one of a hundred then."""
MOSTLY = 0.5
"""Part of a value's variance that is along a direction."""
SMALLEST = 0.1
"""Answer that counts at least for all other values: what chatter makes of theirs is divided by it."""


def unanswered_directions(calibrator: AbstractCalibrator) -> Computation[Combinations]:
    """What the errors of an end lack where all traces are slow: moves of the coordinates whose products with themselves
    are to be added to their covariance, one row for each direction that is answered less than promised.

    None where a trace is not slow, nothing is corrected for, or the search is lost; beside edges of unknown times,
    which corrections would see anew. A direction that can't be asked to both sides stays as it is.

    **Arguments:** `calibrator`: at its end.
    """
    search, task = calibrator.minimiser, calibrator.task
    progress, nothing = search.progress, np.zeros((0, len(search.progress.coordinates)))
    slow = all(lengthens(task.model, trace) for trace in task.fit)
    if not (slow and task.unknown.numerics and progress.around) or progress.lost or progress.edges:
        return nothing
    logarithms = np.asarray(search.problem.transform.positive)
    vague = calibrator.uncertainty().vague(logarithms)
    found = holding(calibrator, vague)
    moves = _directions(found, logarithms)
    back = yield from side_by_side([_answer(calibrator, found, vague, each) for each in moves])
    lacking = [_lacking(calibrator, found, *each) for each in zip(moves, back, strict=True)]
    return np.array([each for each in lacking if np.any(each)]).reshape(-1, nothing.shape[1])


def _directions(found: LeastSquares, logarithms: Bool[np.ndarray, " coordinates"]) -> list[Coordinates]:
    """Along which single logarithms are told, in standard errors, the best told first; each without what others before
    it have of it."""
    errors = np.nan_to_num(found.std_errors)
    asked = np.flatnonzero(found.determined(logarithms) & logarithms & (errors > TOLD))
    factor = root_of(np.nan_to_num(found.covariance))
    taken: list[Float[np.ndarray, " coordinates"]] = []
    for number in asked[np.argsort(errors[asked])]:
        new = factor[number] / errors[number]
        new = new - sum((each * (each @ new) for each in taken), np.zeros(len(new)))
        if new @ new > NEW:
            taken.append(new / np.linalg.norm(new))
    return [factor @ each for each in taken]


def _answer(
    calibrator: AbstractCalibrator, found: LeastSquares, vague: Combinations, along: Coordinates
) -> Computation[Coordinates]:
    """By how much the end would go back after a move, by what the sharp model answers to it on both sides; all of it
    where that can't be asked."""
    beside = yield from answers_beside(calibrator, along, vague, least=NEAREST, most=MOST)
    if len(beside) < 2:
        return along
    places, back = zip((0.0, found.values), *beside, strict=True)
    return np.polyfit(places, np.array(back), 1)[0]


def _lacking(calibrator: AbstractCalibrator, found: LeastSquares, along: Coordinates, back: Coordinates) -> Coordinates:
    """What errors along a move lack where the end goes `back` by less; of a value that has them longer already,
    nothing."""
    columns = finite_columns(calibrator.minimiser.point.columns)
    promised, answered = columns @ along, columns @ back
    answer = float(promised @ answered) / float(promised @ promised)
    if answer >= 1:
        return np.zeros(len(along))
    move = along + (along - back) / max(answer, SMALLEST)
    lacking = np.sign(move) * np.sqrt(np.maximum(move**2 - along**2, 0.0))
    mostly = along**2 > MOSTLY * np.nan_to_num(np.diag(found.covariance))
    return np.where(mostly & (answer < NONE), along * np.sqrt(LEAST**-2 - 1), lacking)
