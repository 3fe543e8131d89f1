"""Corrections of a search that has converged: steps as long as the misfit bears out what its linear model promises."""

import dataclasses

import numpy as np

from ..._errors import SimulationError
from ..._types import Coordinates, Vector
from ..derivatives import Computation
from ..measurements import EVIDENT, MOST_CORRECTIONS, SETTLED, SHORTEST, SMALL_GAIN, FitProblem, turns
from ._abstract_calibrator import C
from ._point import Point, misfit_at

SIZES = (1e4, 1e3, 1e2, 1.0, 1e-2)
"""Inverse damping of steps that are tried where a full one misleads: the first only keeps directions that hardly show
from running away, of the last every coordinate moves by a few thousandths."""
BORNE_OUT = 0.5
"""Part of its promise that a step must keep; a full step keeps all of it where the misfit is a parabola."""
CHATTER = 1.0
"""Rise of chi^2 that is no rise: one standard error, and what a rod that sticks or slips a sample later makes."""
LONGEST_STEP = 0.5
"""Coordinates by which a correction moves at most; farther no linear model reaches."""

MORE_AROUND = 5
"""Corrections beyond the most that there are else, which derivatives over all places may still ask for."""
BEYOND = 3.0
"""Standard errors from where derivatives over all places were taken, beyond which they are taken anew. With 2, of 26
estimates one would be so far off by chance in half of all campaigns: 416 estimates of 16 moved by 0.01 standard errors
in the mean, and by 0.26 at most."""


def trusted(
    problem: FitProblem, point: Point, here: Coordinates, full: Coordinates, part: float
) -> Computation[Coordinates]:
    """Where to go from `here`: after a part of a full linear step if the misfit bears it out, or else of a damped one.

    Where none keeps half of its promise, the one that lowers the misfit most, or else `here`.
    """
    best, lowest = here, 0.0
    for size in (np.inf, *SIZES):
        move = part * (full if np.isinf(size) else point.reduced.damped_steps([size])[0])
        if np.max(np.abs(move)) > LONGEST_STEP:
            continue
        there = np.asarray(problem.transform.clip(here + move))
        found = yield from misfit_at(problem, there)
        if found is None:
            continue
        rise = float(found @ found) - point.chi2
        if rise <= BORNE_OUT * point.reduced.promise(there - here) + CHATTER:
            return there
        if rise < lowest:
            best, lowest = there, rise
    return best


def correcting(calibrator: C) -> Computation[C | None]:
    """The next correction, or `None` where there is none, or none that matters, also not by derivatives over all places
    that the errors leave possible. Along what the traces hardly tell values stay where the search has left them: steps
    would follow each time another chance of the numbers, and none would be near enough to be believed."""
    progress = calibrator.minimiser.progress
    lost = progress.lost or bool(np.any(calibrator.away()))
    if not (calibrator.task.unknown.anything and progress.converged) or progress.settled or lost:
        return None
    nowhere = np.zeros(len(progress.coordinates))
    if not progress.corrections:
        return (yield from _try(calibrator, calibrator.minimiser.point, nowhere, 1.0, nowhere))
    known = calibrator.uncertainty()
    errors = np.where(known.estimable, known.std_errors, np.inf)
    point = calibrator.minimiser.point.holding(known.vague(calibrator.transform.positive))
    found = point.uncertainty(calibrator.minimiser.problem.count)
    step = np.where(known.estimable, -found.values, 0.0)
    wanted = (*progress.wanted, tuple(step.tolist()))
    part = 1 / (1 + len(turns(np.array(wanted) / errors)))
    small = bool(np.all(np.abs(part * step) <= SETTLED * errors))
    if not small and progress.corrections < MOST_CORRECTIONS + MORE_AROUND * bool(progress.around):
        following = yield from _try(calibrator, point, step, part, SETTLED * errors)
        if following is not None:
            return following
        small = found.gain < SMALL_GAIN
    away = np.abs(np.asarray(progress.coordinates) - calibrator.minimiser.slopes.at)
    if not progress.around or bool(np.any(away > BEYOND * errors)):
        return (yield from calibrator.linearised_around())
    calibrator.minimiser.progress = dataclasses.replace(progress, wanted=wanted, settled=small)
    return None


def _try(calibrator: C, point: Point, step: Vector, part: float, least: Vector) -> Computation[C | None]:
    """Corrected after a part of a step, or less of it where the misfit does not bear it out or a simulation fails;
    `None` where that is so for all of it, or what is left moves nothing by more than `least`."""
    search = calibrator.minimiser
    here = np.asarray(search.progress.coordinates)
    while part > SHORTEST:
        there = here
        if np.any(step):
            there = yield from trusted(search.problem, point, here, step, part)
            if np.all(np.abs(there - here) <= least):
                return None
        try:
            return (yield from _go_on(calibrator, step, there))
        except SimulationError:
            part /= 4
    return None


def _go_on(calibrator: C, step: Vector, there: Vector) -> Computation[C]:
    """Corrected at `there` on the way of the step that is wanted, without a delay that may as well be none."""
    progress, errors = calibrator.minimiser.progress, calibrator.uncertainty().std_errors
    coordinates = np.array(there)
    if progress.late and calibrator.task.unknown.duty_delay is not True:
        evident = abs(coordinates[-1]) > EVIDENT * np.nan_to_num(errors[-1])
        coordinates[-1] *= evident
        progress = dataclasses.replace(progress, late=bool(evident))
    slopes = calibrator.minimiser.slopes
    corrected = progress.corrected(coordinates.tolist(), step.tolist(), slopes.at.tolist())
    return (yield from calibrator.corrected(corrected))
