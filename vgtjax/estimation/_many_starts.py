"""A search that begins at many places: on the traces that tell most, and then on all of them from where it ended."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from .._errors import SimulationError
from ._beginning import first_progress, guessed, second_guess, transform_of
from ._evaluation import Steps, side_by_side
from ._point import Coordinates, misfit_at
from ._progress import Progress, Report, quiet
from ._searches import searching_once
from ._starts import AT_ONCE, WORSE, Ended, best_of, searching_from, starts_of
from ._telling import most_telling

C = TypeVar("C", bound=Any)
"""A calibrator."""


def from_many_starts(calibrator: C, report: Report) -> Steps[C]:
    """The search at the best of the ends that it reaches from many starts, if there are to be several.

    They run on the traces that tell most, and where they end together one goes on with all.
    """
    task, progress = calibrator.task, calibrator.minimiser.progress
    if task.starts < 2 or progress.iteration or progress.waterfall:
        return calibrator
    first = first_progress(task)
    starts = starts_of(task, transform_of(task, first), task.starts)
    chosen = most_telling(task, calibrator.minimiser)
    fewer = dataclasses.replace(calibrator, task=task.of_traces(chosen))
    ended = yield from _ending_from(fewer, [dataclasses.replace(first, coordinates=_entries(each)) for each in starts])
    if len(chosen) < len(task.fit):
        ended = yield from _with_all_traces(calibrator, first, ended)
    waterfall = tuple(each.row for each in ended)
    best = yield from calibrator.at(
        dataclasses.replace(first, coordinates=best_of(ended).coordinates, waterfall=waterfall)
    )
    report(best.minimiser.progress)
    return best


def _ending_from(calibrator: C, starts: Sequence[Progress]) -> Steps[list[Ended]]:
    """Where searches from starts end, each from its second guess if that is better."""
    guess, problem = second_guess(calibrator.task), (yield from calibrator.at(starts[0])).minimiser.problem

    def better(start: Progress) -> Steps[Progress]:
        if guess is None:
            return start
        here = np.array(start.coordinates)
        places = [here, guessed(guess, problem.transform, here)]
        found = yield from side_by_side([misfit_at(problem, place) for place in places])
        chi2 = [np.inf if each is None else float(each @ each) for each in found]
        return dataclasses.replace(start, coordinates=_entries(places[int(np.argmin(chi2))]))

    return (yield from searching_from(starts, calibrator.at, better))


def _with_all_traces(calibrator: C, first: Progress, ended: Sequence[Ended]) -> Steps[list[Ended]]:
    """The same ends where the searches that came far go on with all traces, those that have ended together as one."""
    least = min((each.cost for each in ended if each.status == "converged"), default=np.inf)
    onward = {each.coordinates for each in ended if each.status == "converged" and each.cost < WORSE * least}
    places = sorted(onward)
    found = yield from side_by_side([_gone_on(calibrator, first, place) for place in places], AT_ONCE)
    reached = dict(zip(places, found, strict=True))
    return [
        dataclasses.replace(reached[each.coordinates], steps=each.steps + reached[each.coordinates].steps)
        if each.coordinates in onward
        else each
        for each in ended
    ]


def _gone_on(calibrator: C, first: Progress, place: tuple[float, ...]) -> Steps[Ended]:
    try:
        onward = yield from calibrator.at(dataclasses.replace(first, coordinates=place))
    except SimulationError as error:
        return Ended(np.inf, 0, f"failed: {error}")
    end = yield from searching_once(onward, quiet)
    progress = end.minimiser.progress
    status = "converged" if progress.converged else "stuck"
    return Ended(progress.cost, progress.iteration, status, progress.coordinates)


def _entries(coordinates: Coordinates) -> tuple[float, ...]:
    return tuple(coordinates.tolist())
