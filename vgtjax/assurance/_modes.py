"""Whether forward and reverse mode find the same derivatives, as far as these repeat themselves at all."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .._errors import SimulationError
from .._types import Coordinates
from ..estimation import Computation, Evaluated, FitProblem, Slopes, ask, side_by_side

UNEQUAL = 1e-6
"""Part by which a derivative may differ between forward and reverse mode, which differ by rounding alone: in fits of
ours by 1e-12, where a rod sticks and slips by 1e-9."""
NUDGE = 1e-12
"""Part by which coordinates are moved to see how well forward mode repeats itself: nothing beside a standard error."""
NUDGES = 4
"""Places so near that are compared with one another."""
REPEATED = 30
"""Times the largest difference among so few places that two modes may differ by: where a rod turned round at a low
speed for 60 s, places differed by 8e-6 to 3e-5 and modes by 2e-5, elsewhere by 5e-4."""
EXCUSED = 0.01
"""Part that no want of repeatability excuses."""
SEED = 2012

Columns = Float[np.ndarray, "rows coordinates"]


@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Parts by which columns of forward mode differ from what reverse mode finds: along random directions, NaN where
    reverse mode failed, and for each coordinate by itself, with the part that may be."""

    along: list[float]
    apart: Coordinates
    allowed: Coordinates

    @property
    def unequal(self) -> Bool[np.ndarray, " coordinates"]:
        """Coordinates whose derivative is not what reverse mode finds."""
        return self.apart > self.allowed

    @staticmethod
    def compare(
        problem: FitProblem,
        slopes: Slopes,
        columns: Columns,
        moves: Float[np.ndarray, "directions coordinates"],
        usable: Bool[np.ndarray, " coordinates"],
    ) -> Computation["Modes"]:
        """Both modes along `moves`, and by each usable coordinate, as a computation.

        The product of a random combination of columns with all of them: forward mode has it from the columns
        themselves. Where it is not met to rounding, forward mode is asked how well it meets itself.
        """
        columns = columns[: sum(bundle.rows for bundle in problem.bundles)]  # without what is known beforehand
        combined, allowed = columns @ moves.sum(axis=0), np.full(columns.shape[1], UNEQUAL)
        found = yield from _pulled(problem, slopes, combined)
        if found is None:
            return Modes(np.full(len(moves), np.nan).tolist(), np.zeros_like(allowed), allowed)
        difference, size = found - combined @ columns, max(float(np.linalg.norm(combined)), 1e-300)
        lengths = size * np.maximum(np.linalg.norm(columns, axis=0), np.abs(found) / size)
        apart = np.where(usable, _part(difference, lengths), 0.0)
        if np.any(apart > UNEQUAL):
            spread = yield from _spread(problem, slopes, combined)
            allowed = np.maximum(UNEQUAL, np.minimum(REPEATED * _part(spread, lengths), EXCUSED))
        along = size * np.maximum(np.linalg.norm(columns @ moves.T, axis=0), 1e-300)
        return Modes((np.abs(moves @ difference) / along).tolist(), apart, allowed)


def _part(differences: Coordinates, lengths: Coordinates) -> Coordinates:
    """Differences as parts of lengths; all of it where that is no number."""
    parts = np.abs(differences) / np.where(lengths > 0, lengths, 1.0)
    return np.where(np.isfinite(parts), parts, 1.0)


def _pulled(
    problem: FitProblem, slopes: Slopes, combined: Float[np.ndarray, " rows"]
) -> Computation[Coordinates | None]:
    """Products of a combination of residuals with all derivatives, by reverse mode; `None` where that failed."""
    asked = problem.evaluation(slopes.at, slopes=True)
    cotangent = problem.pulled(combined, slopes.evaluated.observed)
    try:
        answer: Evaluated = yield from ask(dataclasses.replace(asked, cotangent=cotangent))
    except SimulationError:
        return None
    more = problem.pulled_edges(cotangent, len(slopes.at))
    return (problem.with_held_delay(np.sum(answer.columns, axis=0)) + more) * np.asarray(
        problem.transform.slope(slopes.at)
    )


def _spread(problem: FitProblem, slopes: Slopes, combined: Float[np.ndarray, " rows"]) -> Computation[Coordinates]:
    """By how much the same products by forward mode differ among places that are nearly one; zero where one failed."""
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (NUDGES, len(slopes.at)))
    places = slopes.at * (1 + NUDGE * signs)
    try:
        found = yield from side_by_side([Slopes.find(problem, place) for place in places])
    except SimulationError:
        return np.zeros(len(slopes.at))
    products = np.array([combined @ problem.columns_of(each.columns, each.at) for each in found])
    spread = np.max(np.abs(products - products[0]), axis=0)
    return np.where(np.isfinite(spread), spread, 0.0)
