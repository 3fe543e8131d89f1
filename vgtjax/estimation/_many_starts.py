"""A search that begins at many places: on the traces that tell most, and then on all of them from where it ended."""

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from .._errors import SimulationError
from ._beginning import first_progress, guess_of, guessed, transform_of
from ._evaluation import Steps, side_by_side
from ._point import Coordinates, misfit_at
from ._progress import Progress, Report, quiet
from ._searches import searching_once
from ._starts import AT_ONCE, REACHED, WORSE, Ended, best_of, searching_from, starts_of
from ._telling import most_telling

C = TypeVar("C", bound=Any)
"""A calibrator."""


def from_many_starts(calibrator: C, report: Report) -> Steps[C]:
    """The search at the best of the ends that it reaches from many starts, if there are to be several.

    Each begins at its second guess if that is better. They run on the traces that tell most, and where they have ended
    together one goes on with all.
    """
    task, progress = calibrator.task, calibrator.minimiser.progress
    if task.starts < 2 or progress.iteration or progress.waterfall:
        return calibrator
    first, guess, problem = first_progress(task), guess_of(task), calibrator.minimiser.problem

    def better(start: Progress) -> Steps[Progress]:
        if guess is None:
            return start
        here = np.array(start.coordinates)
        places = [here, guessed(guess, problem.transform, here)]
        found = yield from side_by_side([misfit_at(problem, place) for place in places])
        chi2 = [np.inf if each is None else float(each @ each) for each in found]
        return dataclasses.replace(start, coordinates=_entries(places[int(np.argmin(chi2))]))

    around = starts_of(task, transform_of(task, first), task.starts)
    starts = [dataclasses.replace(first, coordinates=_entries(each)) for each in around]
    chosen = yield from _chosen(calibrator, (yield from better(first)))
    fewer = dataclasses.replace(calibrator, task=task.of_traces(chosen))
    ended = yield from searching_from(starts, fewer.at, better)
    followed = ended
    if len(chosen) < len(task.fit):
        ended, followed = yield from _with_all_traces(calibrator, first, ended)
    waterfall = tuple(each.row for each in ended)
    place = best_of(followed or ended).coordinates
    best = yield from calibrator.at(dataclasses.replace(first, coordinates=place, waterfall=waterfall))
    report(best.minimiser.progress)
    return best


def _chosen(calibrator: C, start: Progress) -> Steps[list[int]]:
    """Numbers of the traces that tell most where the first of the searches begins."""
    search = calibrator.minimiser
    if start.coordinates != search.progress.coordinates:
        with contextlib.suppress(SimulationError):
            search = (yield from calibrator.at(start)).minimiser
    return most_telling(calibrator.task, search)


def _with_all_traces(calibrator: C, first: Progress, ended: Sequence[Ended]) -> Steps[tuple[list[Ended], list[Ended]]]:
    """The same ends where the searches that came far have gone on with all traces, those that had ended together as
    one, and only these; others are hopeless, by what they left of few traces."""
    least = min((each.cost for each in ended if each.status in REACHED), default=np.inf)
    places = sorted({each.coordinates for each in ended if each.status in REACHED and each.cost < WORSE * least})
    found = yield from side_by_side([_gone_on(calibrator, first, place) for place in places], AT_ONCE)
    reached = dict(zip(places, found, strict=True))
    return [_followed(each, reached.get(each.coordinates)) for each in ended], found


def _followed(few: Ended, far: Ended | None) -> Ended:
    """The end of a start on few traces, and on all if it has gone on with these."""
    if far is None:
        return dataclasses.replace(few, status="hopeless") if few.status in REACHED else few
    status = few.status if far.status in REACHED else far.status
    return dataclasses.replace(far, steps=few.steps + far.steps, status=status)


def _gone_on(calibrator: C, first: Progress, place: tuple[float, ...]) -> Steps[Ended]:
    try:
        onward = yield from calibrator.at(dataclasses.replace(first, coordinates=place))
        progress = (yield from searching_once(onward, quiet)).minimiser.progress
    except SimulationError as error:
        return Ended(np.inf, 0, f"failed: {error}")
    return Ended(
        progress.cost, progress.iteration, "converged" if progress.converged else "stuck", progress.coordinates
    )


def _entries(coordinates: Coordinates) -> tuple[float, ...]:
    return tuple(coordinates.tolist())
