"""How the sharp model answers a delay of the duty, of which derivatives of the smooth one promise more.

A delay carries every jump of the duty through the steps of a simulation, and its derivative has what that does to
their errors, which corrections take out of residuals alone. `docs/estimation.md` ("What derivatives with respect to a
delay promise") has how large the answers were, and why errors are as much longer as they are shorter.
"""

import numpy as np

from ..._types import Coordinates
from ..derivatives import Computation
from ..search import AbstractCalibrator
from ._answers import answers_beside, holding

LEAST = 0.2
"""Of the answer that is promised, at least: errors are never longer than by its inverse."""
NEAREST = 0.5
"""Standard errors by which the delay must be moved: the sharp model chatters by about a tenth of one."""


def unanswered(calibrator: AbstractCalibrator) -> Computation[Coordinates]:
    """What the errors of an end lack as the sharp model answers a delay less than promised: a move of the coordinates,
    whose product with itself is to be added to their covariance.

    Nothing where no delay is free, nothing is corrected for, or the search is lost; beside edges of unknown times,
    which corrections would see anew; and where the end can't be left by `NEAREST` to either side, because a bound is
    near, or a simulation fails, which slices name.

    **Arguments:** `calibrator`: at its end.
    """
    search, task = calibrator.minimiser, calibrator.task
    progress, nothing = search.progress, np.zeros(len(search.progress.coordinates))
    corrected = task.unknown.numerics and progress.around and not progress.lost
    if not (progress.late and corrected) or progress.edges:
        return nothing
    vague = calibrator.uncertainty().vague(search.problem.transform.positive)
    found = holding(calibrator, vague)
    error = float(np.nan_to_num(found.std_errors[-1]))
    if error <= 0:
        return nothing
    along = np.where(found.estimable, found.covariance[-1], 0.0) / error
    beside = yield from answers_beside(calibrator, along, vague, least=NEAREST)
    if not beside:
        return nothing
    places, back = zip((0.0, found.values), *beside, strict=True)
    answer = np.clip(np.polyfit(places, np.array(back)[:, -1], 1)[0] / error, LEAST, 1.0)
    return along * np.sqrt(answer**-2 - 1)
