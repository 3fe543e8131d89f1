"""Steps of corrections: as long as the misfit bears out what its linear model promises."""

import numpy as np

from ._evaluation import Steps
from ._point import Coordinates, Point, misfit_at
from ._residuals import FitProblem

SIZES = (1e4, 1e3, 1e2, 1.0, 1e-2)
"""Inverse damping of steps that are tried where a full one misleads: the first only keeps directions that hardly show
from running away, of the last every coordinate moves by a few thousandths."""
BORNE_OUT = 0.5
"""Part of its promise that a step must keep; a full step keeps all of it where the misfit is a parabola."""
CHATTER = 1.0
"""Rise of chi^2 that is no rise: one standard error, and what a rod that sticks or slips a sample later makes."""
LONGEST_STEP = 0.5
"""Coordinates by which a correction moves at most; farther no linear model reaches."""


def trusted(problem: FitProblem, point: Point, here: Coordinates, full: Coordinates, part: float) -> Steps[Coordinates]:
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
