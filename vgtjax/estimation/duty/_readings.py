"""How the duty of slow traces was held: both readings are fitted, as derivatives where a search has ended mislead.

The one counts whose chi^2 is lower in the mean of where its search and where its corrections end, as either alone has
what one of both readings makes of a seat. `docs/estimation.md` ("How the duty was held") has by how much that was.
"""

import dataclasses

from ..._errors import SimulationError
from .._task import Task
from ..derivatives import Computation, lengthens
from ..measurements import count_of, sample_interval, white_sensors
from ..search import AbstractCalibrator, C, Progress, Report, first_progress, quiet
from ._duty import leaves_only_noise

EVIDENT = 25.0
"""Difference of chi^2 between the ends of both readings from which one of them is out of the question: five standard
errors, and less than of any of the actuators that `docs/estimation.md` names."""

STUCK = 1.05
"""Times the misfit of the other search from which one was stuck: of the same actuators the wrong reading left at most
two percent more."""


def leaves_hold_open(task: Task) -> bool:
    """Whether a fit is to tell how the duty was held, and all of its traces are slow."""
    slow = all(lengthens(task.model, trace) for trace in task.fit)
    return bool(slow and task.late_duty and task.unknown.duty_hold)


def reading_both_ways(calibrator: C, report: Report) -> Computation[C]:
    """A fit at its end, or that of the other reading if this meets the traces better, knowing where the one not taken
    has ended if it is not out of the question.

    A duty whose delay is free is the same in either, but none comes early: that one was linear, if it meets the noise.
    What is tried is not reported: a fit that is interrupted meanwhile tries it again.
    """
    progress = calibrator.minimiser.progress
    told = progress.late and calibrator.task.unknown.duty_delay == "evidence"
    early = told and not progress.linear and progress.coordinates[-1] < 0
    asked = progress.otherwise is not None or (progress.late and not early) or progress.edges
    if asked or not leaves_hold_open(calibrator.task) or calibrator.is_lost():
        return calibrator
    every = tuple(sorted({sample_interval(trace) for trace in calibrator.task.fit}))
    other = yield from _read(calibrator, () if progress.linear else every)
    if other is not None and not early:
        calibrator = yield from _unstuck(calibrator, other)
        other = yield from _unstuck(other, calibrator)
    if other is None:
        best, second = calibrator, None
    elif early:
        best, second = other, None
    else:
        best, second = sorted((calibrator, other), key=_misfit)
        second = None if _misfit(second) - _misfit(best) > EVIDENT else second
    stuck = other is not None and not early and (_is_stuck(calibrator, other) or _is_stuck(other, calibrator))
    decided = second is None and not stuck and leaves_only_noise(best.task, best.minimiser)
    otherwise = () if second is None else second.minimiser.progress.coordinates
    best.minimiser.progress = dataclasses.replace(
        best.minimiser.progress, otherwise=otherwise, hold_decided=decided and not best.minimiser.progress.late
    )
    report(best.minimiser.progress)
    return best


def _misfit(end: AbstractCalibrator) -> float:
    """Chi^2 of a fit, but for what both readings have in common: the mean of where its search has ended and where its
    corrections have, with what the size of the noise costs that these have found. Student's loss has no such cost: its
    weights leave about as much of chi^2 whatever the noise."""
    task, search = end.task, end.minimiser
    searched = 2 * count_of(white_sensors(task.traces, task.channels)) * search.progress.searched
    if task.unknown.loss == "student":
        return searched
    levels = sum(sensor.cost for sensors in end.sensors for sensor in sensors.values())
    return 0.5 * (searched + search.point.chi2 + levels)


def _is_stuck(end: AbstractCalibrator, other: AbstractCalibrator) -> bool:
    """Whether a search has ended so far above the other one that this says nothing of its reading."""
    return end.minimiser.progress.searched > STUCK * other.minimiser.progress.searched


def _unstuck(end: C, other: C) -> Computation[C]:
    """The end of a reading or, if its search was stuck, that of one which begins where the other reading has ended: of
    one held unit of twenty only that of a linear duty had met the traces."""
    if not _is_stuck(end, other):
        return end
    progress = other.minimiser.progress
    again = yield from _read(end, end.minimiser.progress.linear, progress.found or progress.coordinates)
    better = again is not None and again.minimiser.progress.searched < end.minimiser.progress.searched
    return again if again is not None and better else end


def _read(calibrator: C, linear: tuple[float, ...], begin: tuple[float, ...] | None = None) -> Computation[C | None]:
    """The end of a fit that reads the duty as linear at these intervals and else as held, not late, from where the
    search began or from another place; `None` if it leaves more than noise."""
    progress = calibrator.minimiser.progress
    begin = begin or progress.began or first_progress(calibrator.task).coordinates
    afresh = Progress((*begin[:-1], 0.0), linear=linear, finer=progress.finer, waterfall=progress.waterfall)
    try:
        end = yield from calibrator.searching_from(afresh, quiet)
        if end.is_lost() or not leaves_only_noise(end.task, end.minimiser):
            return None
        return (yield from end.corrected_to_its_end(quiet))
    except SimulationError:
        return None
