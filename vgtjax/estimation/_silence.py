"""Along which directions slow traces tell less than derivatives promise.

While a slow duty carries a plunger to its seat, this hovers and chatters there, in the smooth model as well as in the
sharp one. A derivative has how the phase of the chatter moves with every parameter, which in a few thousand samples
looks like information: stiffness of the membrane and slope of the reservoir's orifice to 2.5 %, which together no trace
tells, and half of twenty actuators were more than two such errors off. The sharp model chatters otherwise. Moved by
four standard errors along this direction, it answers by 0.13 of what is promised, and by 0.7 to 1.0 along those
of the friction.

Where an end solves `J^T r = 0` with derivatives `J` of another model than that of the residuals `r`, noise moves it by
`A^-1 (J^T J)^-1 J^T` with `A = (J^T J)^-1 J^T dr/dx` (estimating equations, Huber 1967). If all else is answered as
promised, and a move `m` of one standard error by `A m = x`, its part along `m` being `a`, an error along `m` is one
along `m + (m - x) / a`.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import SimulationError
from ._delay_response import Combinations, reach_of
from ._evaluation import Steps, side_by_side
from ._least_squares import LeastSquares, finite_columns
from ._slopes import Coordinates
from ._steps import lengthens

TOLD = 0.01
"""Standard error of a logarithm up to which its own direction is not asked: what hover has to say is weaker."""
MOST = 4.0
"""Standard errors by which it is moved to either side at most: chatter makes an answer uncertain by half of one."""
NEW = 0.3
"""Part of a direction's square that those before it do not have, at least, for it to be asked."""
NONE, LEAST = 0.25, 0.02
"""Answer up to which there is none, and what counts for that along values that lie along the direction by `MOSTLY`:
errors of two percent are a factor of ten then."""
MOSTLY = 0.5
"""Part of a value's variance that is along a direction."""
SMALLEST = 0.1
"""Answer that counts at least for all other values: of theirs, chatter makes a tenth of a standard error."""


def unheard(calibrator: Any) -> Steps[Combinations]:
    """Moves of the coordinates whose products with themselves are to be added to the covariance of an end, as the sharp
    model answers them less than derivatives promise; one row for each direction that is asked.

    None where a trace is not slow, nothing is corrected for, or the search is lost; beside edges of unknown times,
    which corrections would see anew.

    **Arguments:** `calibrator`: at its end.
    """
    search, task = calibrator.minimiser, calibrator.task
    progress, nothing = search.progress, np.zeros((0, len(search.progress.coordinates)))
    slow = all(lengthens(task.model, trace) for trace in task.fit)
    if not (slow and task.unknown.numerics and progress.around) or progress.lost or progress.edges:
        return nothing
    logarithms = np.asarray(search.problem.transform.positive)
    vague = calibrator.uncertainty().vague(logarithms)
    found = _held(calibrator, vague)
    moves = _directions(found, logarithms)
    answers = yield from side_by_side([_answer(calibrator, vague, each) for each in moves])
    lacking = [_lacking(calibrator, found, *each) for each in zip(moves, answers, strict=True)]
    return np.array([each for each in lacking if np.any(each)]).reshape(-1, nothing.shape[1])


def _held(calibrator: Any, vague: Combinations) -> LeastSquares:
    """The linear problem at a place, without what the traces hardly tell."""
    search = calibrator.minimiser
    return search.point.holding(vague).uncertainty(search.problem.count)


def _directions(found: LeastSquares, logarithms: Bool[np.ndarray, " coordinates"]) -> list[Coordinates]:
    """Along which single logarithms are told, in standard errors, the best told first; each without what others before
    it have of it."""
    errors = np.nan_to_num(found.std_errors)
    asked = np.flatnonzero(found.tells(logarithms) & logarithms & (errors > TOLD))
    sizes = np.where(errors > 0, errors, 1.0)
    parts, ways = np.linalg.eigh(np.nan_to_num(found.covariance) / np.outer(sizes, sizes))
    factor = sizes[:, None] * ways * np.sqrt(np.maximum(parts, 0.0))
    taken: list[Float[np.ndarray, " coordinates"]] = []
    for number in asked[np.argsort(errors[asked])]:
        new = factor[number] / errors[number]
        new = new - sum((each * (each @ new) for each in taken), np.zeros(len(new)))
        if new @ new > NEW:
            taken.append(new / np.linalg.norm(new))
    return [factor @ each for each in taken]


def _answer(calibrator: Any, vague: Combinations, along: Coordinates) -> Steps[Coordinates]:
    """By how much the end would go back after a move of it, by what the sharp model answers to moves to either side;
    all of it where that can't be asked."""
    search = calibrator.minimiser
    here = np.array(search.progress.coordinates)
    places, wanted = [0.0], [_held(calibrator, vague).values]
    for side in (1.0, -1.0):
        reach = reach_of(search.problem.transform, here, side * along, MOST)
        there = tuple((here + side * reach * along).tolist())
        try:
            beside = yield from calibrator.corrected(dataclasses.replace(search.progress, coordinates=there))
        except SimulationError:
            continue
        places.append(side * reach)
        wanted.append(_held(beside, vague).values)
    if len(places) < 3 or not np.all(np.isfinite(wanted)):
        return along
    return np.polyfit(places, np.array(wanted), 1)[0]


def _lacking(calibrator: Any, found: LeastSquares, along: Coordinates, back: Coordinates) -> Coordinates:
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
