"""How the sharp model answers a delay of the duty, of which derivatives of the smooth one promise more.

A delay carries every jump of the duty through the steps of a simulation, and its derivative has what that does to
their errors. Corrections take errors out of residuals, not out of derivatives: of 25 campaigns with a duty that is
4 ms late, a delay that is moved by its standard error, and all else with it, moves what corrections want by 0.5 to 1
of that; of campaigns with a timely duty the least determined direction answers by 0.97 to 1.03, in the middle. Where
an end solves `J^T r = 0` with derivatives `J` of another model than that of the residuals `r`, noise moves it by
`(J^T dr/dx)^-1 J^T` (estimating equations, Huber 1967), so errors are as much longer as the answer is shorter.
"""

import dataclasses
from typing import Any

import numpy as np

from .._errors import SimulationError
from ._evaluation import Steps
from ._slopes import FARTHEST, Coordinates

LEAST = 0.2
"""Of the answer that is promised: below, it can't be told from the chatter of the sharp model."""


def unanswered(calibrator: Any) -> Steps[Coordinates]:
    """What the errors of an end lack as the sharp model answers a delay less than promised: a move of the coordinates,
    whose product with itself is to be added to their covariance. Nothing where no delay is free, or nothing is
    corrected for; not asked beside edges of unknown times, where corrections would see these anew, nor told where
    neither side can be simulated, which slices name.

    **Arguments:** `calibrator`: at its end.
    """
    search, task = calibrator.minimiser, calibrator.task
    progress, found = search.progress, calibrator.uncertainty()
    here = np.array(progress.coordinates)
    asked = task.unknown.numerics and progress.late and progress.corrections and not progress.edges
    if not (asked and found.determined[-1]):
        return np.zeros(len(here))
    error = float(found.std_errors[-1])
    along = np.where(found.determined, found.covariance[-1], 0.0) / error
    reach = min(1.0, FARTHEST / float(np.max(np.abs(along))))
    places, answers = [0.0], [_wanted(calibrator)]
    for side in (reach, -reach):
        there = np.asarray(search.problem.transform.clip(here + side * along))
        try:
            beside = yield from calibrator.corrected(dataclasses.replace(progress, coordinates=tuple(there.tolist())))
        except SimulationError:
            continue
        places.append(float(there[-1] - here[-1]) / error)
        answers.append(_wanted(beside))
    if len(places) < 2 or np.ptp(places) == 0:
        return np.zeros(len(here))
    answer = np.clip(-np.polyfit(places, answers, 1)[0] / error, LEAST, 1.0)
    return along * np.sqrt(answer**-2 - 1)


def _wanted(calibrator: Any) -> float:
    """By how much the next correction wants to move the delay, without what the traces hardly tell."""
    problem = calibrator.minimiser.problem
    point = calibrator.minimiser.point.holding(calibrator.uncertainty().vague(problem.transform.positive))
    return -float(point.uncertainty(problem.count).values[-1])
