"""A search that begins at many places: on the parts of traces that tell most, and then on all from where it ended."""

import contextlib
import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..._errors import SimulationError
from ..._types import Coordinates
from ..derivatives import Computation, side_by_side
from ..measurements import FitProblem
from ._abstract_calibrator import C
from ._beginning import first_progress, guess_of, guessed, problem_of, transform_of
from ._point import misfit_at
from ._progress import Progress, Report, quiet
from ._searches import MOST_RESCUES, searching_once
from ._starts import AT_ONCE, REACHED, WORSE, Ended, best_of, searching_from, starts_of
from ._telling import most_telling

FAR = 100.0
"""An end on parts of traces is no optimum where all traces leave that many times the chi^2 that they leave elsewhere:
ten times the error. Errors of estimation that are ten times as large, which parts may leave, are far less."""


def from_many_starts(calibrator: C, report: Report) -> Computation[C]:
    """The search at the best of the ends that it reaches from many starts, if there are to be several.

    Each begins at its second guess if that is better. They run on the parts of traces that tell most, and where they
    have ended together one goes on with all.
    """
    task, progress = calibrator.task, calibrator.minimiser.progress
    if task.starts < 2 or progress.iteration or progress.waterfall:
        return calibrator
    first, guess = first_progress(task), guess_of(task)
    around = starts_of(task, transform_of(task, first), task.starts)
    starts = [dataclasses.replace(first, coordinates=_entries(each)) for each in around]
    begins = yield from _better(calibrator.minimiser.problem, guess, first)
    chosen = yield from _chosen(calibrator, begins)
    fewer = dataclasses.replace(calibrator, task=task.of_parts(chosen))
    better = functools.partial(_better, problem_of(fewer.task, first), guess)
    ended = yield from searching_from(starts, fewer.at, better)
    followed = ended
    if chosen != {number: len(trace.time) for number, trace in enumerate(task.fit)}:
        ended, followed = yield from _with_all_traces(calibrator, first, ended)
    waterfall = tuple(each.row for each in ended)
    place = best_of(followed or ended).coordinates
    best = yield from calibrator.at(dataclasses.replace(first, coordinates=place, waterfall=waterfall))
    report(best.minimiser.progress)
    return best


def _better(problem: FitProblem, guess: Float[np.ndarray, " entries"] | None, start: Progress) -> Computation[Progress]:
    """A start, or its second guess if that is better."""
    if guess is None:
        return start
    here = np.array(start.coordinates)
    places = [here, guessed(guess, problem.transform, here)]
    found = yield from side_by_side([misfit_at(problem, place) for place in places])
    chi2 = [np.inf if each is None else float(each @ each) for each in found]
    return dataclasses.replace(start, coordinates=_entries(places[int(np.argmin(chi2))]))


def _chosen(calibrator: C, start: Progress) -> Computation[dict[int, int]]:
    """Samples of the traces that tell most where the first of the searches begins, by number."""
    search = calibrator.minimiser
    if start.coordinates != search.progress.coordinates:
        with contextlib.suppress(SimulationError):
            search = (yield from calibrator.at(start)).minimiser
    return most_telling(calibrator.task, search)


def _with_all_traces(
    calibrator: C, first: Progress, ended: Sequence[Ended]
) -> Computation[tuple[list[Ended], list[Ended]]]:
    """The same ends where the searches that came far have gone on with all traces, those that had ended together as
    one, and only these; others are hopeless, by what they leave of few traces or of all."""
    least = min((each.cost for each in ended if each.status in REACHED), default=np.inf)
    places = sorted({each.coordinates for each in ended if each.status in REACHED and each.cost < WORSE * least})
    residuals = yield from side_by_side([misfit_at(calibrator.minimiser.problem, np.array(each)) for each in places])
    chi2 = [np.inf if each is None else float(each @ each) for each in residuals]
    good = [place for place, each in zip(places, chi2, strict=True) if each < FAR * min(chi2)]
    found = yield from side_by_side([_gone_on(calibrator, first, place, rescues=0) for place in good], AT_ONCE)
    least = min((each.cost for each in found if each.status in REACHED), default=np.inf)
    task = dataclasses.replace(calibrator.task, ceiling=min(calibrator.task.ceiling, least))
    beside = dataclasses.replace(calibrator, task=task)
    found = yield from side_by_side([_rescued(beside, first, each) for each in found], AT_ONCE)
    reached = dict(zip(good, found, strict=True))
    return [_followed(each, reached.get(each.coordinates)) for each in ended], found


def _rescued(calibrator: C, first: Progress, end: Ended) -> Computation[Ended]:
    """An end gone on without what ran away, if anything did."""
    if end.status in REACHED or not end.coordinates:
        return end
    onward = yield from _gone_on(calibrator, first, end.coordinates)
    return dataclasses.replace(onward, steps=end.steps + onward.steps)


def _followed(few: Ended, far: Ended | None) -> Ended:
    """The end of a start on few traces, and on all if it has gone on with these."""
    if far is None:
        return dataclasses.replace(few, status="hopeless") if few.status in REACHED else few
    status = few.status if far.status in REACHED else far.status
    return dataclasses.replace(far, steps=few.steps + far.steps, status=status)


def _gone_on(
    calibrator: C, first: Progress, place: tuple[float, ...], rescues: int = MOST_RESCUES
) -> Computation[Ended]:
    """Where the search with all traces ends that begins at the end of one on parts of them."""
    try:
        onward = yield from calibrator.at(dataclasses.replace(first, coordinates=place))
        search = yield from searching_once(onward, quiet, rescues)
    except SimulationError as error:
        return Ended(np.inf, 0, f"failed: {error}")
    progress = search.minimiser.progress
    status = "converged" if progress.converged and not np.any(search.away()) else "stuck"
    return Ended(progress.cost, progress.iteration, status, progress.coordinates)


def _entries(coordinates: Coordinates) -> tuple[float, ...]:
    return tuple(coordinates.tolist())
