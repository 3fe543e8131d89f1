"""Searches to their end: begun again where one got stuck or far off, and on without what ran away."""

import dataclasses

import numpy as np

from ..._errors import SimulationError
from .._task import Task
from ..derivatives import Computation
from ..measurements import RECORDED
from ._abstract_calibrator import AbstractCalibrator, C
from ._beginning import first_progress, guess_of, guessed, transform_of
from ._noise_met import meets_noise
from ._progress import LENGTHS, Progress, Report, quiet

MOST_RESCUES = 4
"""Times that a search goes on without what ran away before it is lost."""

TRIED, FAR_ABOVE, MOST_TO_GO = 4, 1000.0, 20
"""A search may be given up after so many steps, if chi^2 is so much above its ceiling, and so many more steps like the
last one would not bring it down to that; or where it ends so much above; or at once, where without what ran away it is
so many times its ceiling."""

FAR_OFF = 50.0
"""Cost of an end that is tried again from the second guess of where it began: ten times the noise. What a simulation
never reaches, a stop or an open valve, it does not depend on, and a search may end there after one step."""
SECOND_GUESS = "the search begins at what slow motion and equilibria tell of springs, travel and magnetic force"


def searching(calibrator: C, report: Report) -> Computation[C]:
    """A search to its end; begun again while it gets stuck above the noise."""
    return (yield from beginning_again((yield from searching_once(calibrator, report)), report))


def from_second_guess(ended: C, report: Report) -> Computation[C]:
    """The better of a search that has ended far above the noise, and one from the second guess of where it began; not
    of another structure, which began where one has ended."""
    progress = ended.minimiser.progress
    asked = progress.corrections or progress.linear or progress.edges
    known = asked or progress.late != first_progress(ended.task).late or np.isfinite(ended.task.ceiling)
    if known or progress.given_up or progress.cost < FAR_OFF:
        return ended
    guess, again = guess_of(ended.task), progress.begun_again(LENGTHS[0])
    if guess is None:
        return ended
    there = guessed(guess, transform_of(ended.task, again), np.array(again.coordinates))
    try:
        onward = yield from ended.at(dataclasses.replace(again, coordinates=tuple(there.tolist())))
        other = yield from searching_once(onward, quiet)
    except SimulationError:
        return ended
    best = min(ended, other, key=_worse)
    if best is other:
        report(other.minimiser.progress)
        best = dataclasses.replace(other, notes=(*other.notes, SECOND_GUESS))
    return best


def _worse(ended: AbstractCalibrator) -> tuple[bool, float]:
    """What ends of searches are ordered by: one that has converged is better, and then one of less cost."""
    progress = ended.minimiser.progress
    return not progress.converged, progress.cost


def beginning_again(ended: C, report: Report) -> Computation[C]:
    """The best of a search that has ended and of those by moves of other lengths, as long as all get stuck above the
    noise.

    What is tried is not reported: a fit that is interrupted meanwhile tries all of it again.
    """
    first = ended
    for longest in LENGTHS[1:]:
        if not _got_stuck(ended):
            break
        onward = yield from ended.at(ended.minimiser.progress.begun_again(longest))
        again = yield from searching_once(onward, quiet)
        ended = min(ended, again, key=_worse)
    if ended is not first:
        report(ended.minimiser.progress)
    return ended


def without_ceiling(calibrator: C) -> Computation[C]:
    """A search at its start without its ceiling, if another one comes near that with the reading of the duty that
    belongs to it. With the duty as recorded a right structure may be far above until its search has ended, as only then
    the traces tell how to read it.

    What is tried is not reported: a fit that is interrupted meanwhile tries it again. One that reads the duty otherwise
    already has come near.
    """
    task, progress = calibrator.task, calibrator.minimiser.progress
    if task.reading == RECORDED or progress.given_up:
        return calibrator
    late = progress.late != first_progress(task).late
    if not (progress.corrections or progress.linear or progress.edges or late):
        try:
            read = yield from calibrator.at(_read_as(task, progress))
            read = yield from giving_up((yield from searching_once(read, quiet)), quiet)
        except SimulationError:
            return calibrator
        if read.minimiser.progress.given_up:
            return calibrator
    return dataclasses.replace(calibrator, task=dataclasses.replace(task, ceiling=np.inf, reading=RECORDED))


def _read_as(task: Task, progress: Progress) -> Progress:
    """Where a search begins, with the reading of the duty that belongs to its ceiling."""
    reading, first = task.reading, first_progress(task, task.reading.delay)
    begin = (*(progress.began or progress.coordinates)[:-1], first.coordinates[-1])
    read = dataclasses.replace(first, coordinates=begin, linear=reading.linear)
    return read.moving_edges(begin, first.late, reading.edges) if reading.edges else read


def giving_up(ended: C, report: Report) -> Computation[C]:
    """A search that has ended far above its ceiling, given up unless it was stuck and ends elsewhere when it begins
    again. The traces say nothing of their duty by a structure that is so far off, and to ask takes longer than to
    search."""
    if not _is_far_above(ended):
        return ended
    ended = yield from beginning_again(ended, report)
    if _is_far_above(ended):
        ended.minimiser.progress = dataclasses.replace(ended.minimiser.progress, given_up=True, converged=False)
        report(ended.minimiser.progress)
    return ended


def _is_far_above(calibrator: AbstractCalibrator) -> bool:
    """Whether a search without corrections is far above the cost that another structure reaches, and not given up."""
    progress = calibrator.minimiser.progress
    above = 2 * calibrator.minimiser.problem.count * (progress.cost - calibrator.task.ceiling)
    return above > FAR_ABOVE and not (progress.corrections or progress.given_up)


def _got_stuck(calibrator: C) -> bool:
    """Whether a search has ended above the noise where its moves led nowhere."""
    progress = calibrator.minimiser.progress
    smoothly = progress.converged and not progress.stalled
    return not (progress.corrections or smoothly or meets_noise(calibrator.minimiser))


def searching_once(calibrator: C, report: Report, rescues: int = MOST_RESCUES) -> Computation[C]:
    """A search to its end, on without what ran away, so many times at most."""
    yield from _search(calibrator, report)
    for _ in range(rescues):
        onward = yield from _without_runaways(calibrator)
        if onward is calibrator:
            break
        calibrator, progress = onward, onward.minimiser.progress
        if progress.cost > FAR_ABOVE * calibrator.task.ceiling:
            calibrator.minimiser.progress = dataclasses.replace(progress, given_up=True)
        yield from _search(calibrator, report)
    return calibrator


def _search(calibrator: C, report: Report) -> Computation[None]:
    """Steps until the search has ended, and what was held on the way is judged."""
    minimiser = calibrator.minimiser
    while not minimiser.progress.finished:
        yield from minimiser.steps()
        hopeless = _is_hopeless(minimiser.progress, calibrator.task.ceiling, minimiser.problem.count)
        minimiser.progress = dataclasses.replace(minimiser.progress, given_up=hopeless)
        report(minimiser.progress)
    progress = minimiser.progress
    if progress.let_go is not None and not progress.corrections:
        minimiser.progress = dataclasses.replace(progress, lost=calibrator.worth(progress.cost - progress.let_go))


def _is_hopeless(progress: Progress, ceiling: float, count: int) -> bool:
    """Whether a search is far above a cost, and its last step brought little of the way."""
    above = progress.cost - ceiling
    if progress.finished or progress.iteration < TRIED or 2 * count * above < FAR_ABOVE:
        return False
    return MOST_TO_GO * (progress.history[-2] - progress.cost) < above


def _without_runaways(calibrator: C) -> Computation[C]:
    """The search gone on with what ran away held at its start, as a value that changes nothing spoils no other; or
    freed again, if the search had only lost its way: then holding has made it better."""
    progress, away = calibrator.minimiser.progress, calibrator.away()
    if np.any(away):
        start = np.asarray(calibrator.transform.to_coordinates(calibrator.task.first_guess))
        coordinates = np.where(away, start, np.asarray(progress.coordinates))
        onward = progress.holding(np.flatnonzero(away).tolist(), coordinates.tolist())
    elif progress.let_go is not None and calibrator.worth(progress.let_go - progress.cost):
        onward = progress.freed()
    else:
        return calibrator
    return (yield from calibrator.at(onward))
