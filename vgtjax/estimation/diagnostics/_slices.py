"""The misfit around the end of a fit, along every direction that the traces tell: a parabola where errors are honest.

Standard errors come from a linear model. What the misfit really does two standard errors away needs a
simulation on either side, and no derivative.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..._types import Coordinates
from .._calibrator import Calibrator
from .._least_squares import NULL, LeastSquares, pseudo_inverse
from ..derivatives import Computation, side_by_side
from ..measurements import FitProblem
from ..search import Point, misfit_at

FAR, NEAR_BY = 2.0, 1.0
"""Standard errors at which a slice is looked at: all at the first, where a 95 % interval ends, on either side; those
that are no parabolas at the second as well, which tells a kink from a curve."""
MOST_EVALUATIONS = 110
"""Simulations of all traces that slices may take, the least determined directions first."""
MINOR = 0.3
"""Largest loading below which a direction is looked at on one side only, unless that is no parabola: it carries less
than a tenth of any variance. With all on both sides, slices took a third as long as the rest of a fit."""
HONEST = 1.25
"""Factor by which the error that a misfit really shows may differ from the linear one: what intervals are measured to
be right to (`calibrate.bench`, coverage), and more than the chatter of a search that settles to a fifth of an error."""
FLAT = 0.5
"""Part of the linear distance at which a misfit two standard errors away is called flat: it is below one."""
KINKED = 1.4
"""How much wider than a parabola a misfit is near its minimum where it has a kink; 1 is none, 2 nothing else."""
SHIFTED = 0.5
"""Standard errors from the end to the minimum of a parabola that count: corrections that have settled leave 0.2."""
DOWNHILL = -1.0
"""Rise of the misfit below which the fit did not end at a minimum: one standard error."""
CARRIES = 0.5
"""Loading from which a parameter carries a direction: a quarter of its variance."""


@dataclasses.dataclass(frozen=True, eq=False)
class End:
    """Where a fit ended: the problem in the weights of its own sensors, linearised, without the scatter of corrections.

    `entries` name the coordinates; the delay of the duty, where it is one, is `duty_delay`.
    """

    problem: FitProblem
    at: Coordinates
    point: Point
    found: LeastSquares
    entries: Sequence[str]

    @staticmethod
    def of(calibrator: Calibrator) -> "End":
        """The end of a calibration."""
        search, entries = calibrator.minimiser, list(calibrator.task.selection.entries)
        at = np.array(search.progress.coordinates)
        names = [*entries, "duty_delay"][: len(at)]
        return End(search.problem, at, search.point, calibrator.uncertainty(), names)

    def clipped(self, coordinates: Coordinates) -> Coordinates:
        """The nearest coordinates inside the bounds."""
        return np.asarray(self.problem.transform.clip(coordinates))

    def residuals(self, coordinates: Coordinates) -> Computation[Float[np.ndarray, " residuals"] | None]:
        """What the misfit is made of elsewhere; `None` where a simulation fails."""
        return misfit_at(self.problem, coordinates)

    def rise(self, residuals: Float[np.ndarray, " residuals"] | None) -> float:
        """By how much chi^2 is above the end's, in units of the variance of what remains there."""
        if residuals is None:
            return np.inf
        return (float(residuals @ residuals) - self.point.chi2) / self.found.scale

    @functools.cached_property
    def directions(self) -> "Directions":
        """Directions of the whitened covariance."""
        return Directions.of(self)


@dataclasses.dataclass(frozen=True, eq=False)
class Directions:
    """Independent directions of what is estimable, by the eigenvectors of the correlation, the least known first.

    `moves` has a standard error of each in coordinates, `loadings` the part of each coordinate's own error that this
    is; their squares sum to one for every coordinate.
    """

    moves: Float[np.ndarray, "coordinates directions"]
    loadings: Float[np.ndarray, "coordinates directions"]

    @staticmethod
    def of(end: End) -> "Directions":
        """By a singular value decomposition of columns in standard errors: the covariance itself would lose digits."""
        known, columns = end.found.estimable, end.point.reduced.columns
        told, others = columns[:, known], columns[:, ~known]
        # What is not estimable follows, as a standard error is one whatever it does.
        follow = -pseudo_inverse(others) @ told
        left, errors = told + others @ follow, end.found.std_errors[known]
        _, sizes, ways = np.linalg.svd(left * (errors / np.sqrt(end.found.scale)), full_matrices=False)
        real = sizes > NULL * np.max(sizes, initial=0.0)
        ways, sizes = ways[real][::-1], sizes[real][::-1]
        moves, loadings = np.zeros((2, len(known), len(sizes)))
        loadings[known] = ways.T / sizes
        moves[known] = errors[:, None] * loadings[known]
        moves[~known] = follow @ moves[known]
        return Directions(moves, loadings)


@dataclasses.dataclass(frozen=True, eq=False)
class Slice:
    """The misfit along one direction: `values` of its rise at `reaches` in standard errors, a parabola at 4, 1, 1, 4.

    `loadings` are those of all entries, by name; infinite values are simulations that failed. `bent` has the same
    values without what the slope at the end explains, by the square of the distance that the bounds left: one for a
    parabola, NaN where they left none. `shift` is where that slope puts the minimum, in standard errors.
    """

    direction: int
    loadings: dict[str, float]
    reaches: tuple[float, ...]
    values: tuple[float, ...]
    bent: tuple[float, ...]
    shift: float = 0.0

    @property
    def carried_by(self) -> list[str]:
        """The parameters that carry the direction, the largest loading first."""
        ranked = sorted(self.loadings, key=lambda name: -abs(self.loadings[name]))
        return [name for name in ranked if abs(self.loadings[name]) >= CARRIES] or ranked[:1]

    @property
    def is_parabola(self) -> bool:
        """Whether the standard error is what the misfit shows."""
        return self.verdict == "parabola"

    @property
    def verdict(self) -> str:
        """One word for the shape."""
        far = np.array([b for t, b in zip(self.reaches, self.bent, strict=True) if abs(t) == FAR and not np.isnan(b)])
        near = np.array([b for t, b in zip(self.reaches, self.bent, strict=True) if abs(t) != FAR])
        if np.any(np.isinf(self.values)):
            return "fails"
        if min(self.values) < DOWNHILL:
            return "downhill"
        if not len(far):
            return "at bounds"
        distance = np.sqrt(np.maximum(far, 0.0))  # 1 for a parabola
        if np.all((distance > 1 / HONEST) & (distance < HONEST)):
            return "shifted" if abs(self.shift) > SHIFTED else "parabola"
        if np.all(distance < FLAT):
            return "flat"
        if len(near) == len(far) and np.all(np.isfinite(near)) and np.mean(near) > KINKED * np.mean(far) > 0:
            return "kinked"
        if distance.max() > HONEST**2 * distance.min():
            return "skewed"
        return "narrow" if distance.mean() > 1 else "wide"


WORDS = {
    "parabola": "errors are as linear as they claim",
    "shifted": "a parabola, but its minimum is more than half a standard error away",
    "flat": "the misfit hardly rises: less is known than errors say",
    "kinked": "the misfit rises like a roof: the model has a kink here",
    "skewed": "the misfit rises faster on one side",
    "narrow": "the misfit rises faster than linear on both sides: errors are too large",
    "wide": "the misfit rises slower than linear on both sides: errors are too small",
    "downhill": "the misfit falls: the fit is not at its minimum along this",
    "fails": "the simulation fails within two standard errors",
    "at bounds": "bounds leave less than half a standard error on both sides",
}
"""What the verdicts on slices mean."""


@dataclasses.dataclass(frozen=True, eq=False)
class Slices:
    """All slices of a fit, the least determined direction first; `left_out` counts directions not looked at."""

    slices: list[Slice]
    left_out: int
    evaluations: int

    @property
    def no_parabolas(self) -> list[Slice]:
        """Where the misfit is something else."""
        return [each for each in self.slices if not each.is_parabola]

    def flagged(self) -> list[str]:
        """Entries that carry a direction which is no parabola, the largest loading first."""
        worst: dict[str, float] = {}
        for each in self.no_parabolas:
            for name in each.carried_by:
                worst[name] = max(worst.get(name, 0.0), abs(each.loadings[name]))
        return sorted(worst, key=lambda name: -worst[name])


def slicing(end: End) -> Computation[Slices]:
    """Slices along all directions, as a computation."""
    sizes = np.max(np.abs(end.directions.loadings), axis=0, initial=0.0)
    wanted, evaluations = [], 0
    for size in sizes:
        reaches = (-FAR, FAR) if size >= MINOR else (FAR,)
        if evaluations + len(reaches) > MOST_EVALUATIONS:
            break
        wanted.append(reaches)
        evaluations += len(reaches)
    found = yield from side_by_side([_slice(end, *each) for each in enumerate(wanted)])
    again = {}
    for direction, far in enumerate(found):
        more = [reach for reach in (-FAR, -NEAR_BY, NEAR_BY, FAR) if reach not in far.reaches]
        if not far.is_parabola and evaluations + len(more) <= MOST_EVALUATIONS:
            again[direction] = more
            evaluations += len(more)
    nearer = yield from side_by_side([_slice(end, *each) for each in again.items()])
    for direction, near in zip(again, nearer, strict=True):
        found[direction] = _joined(found[direction], near)
    return Slices(found, len(sizes) - len(found), evaluations)


def _slice(end: End, direction: int, reaches: Sequence[float]) -> Computation[Slice]:
    move = end.directions.moves[:, direction]
    places = [end.clipped(end.at + reach * move) for reach in reaches]
    residuals = yield from side_by_side([end.residuals(there) for there in places])
    values, bent = [], []
    for reach, there, left in zip(reaches, places, residuals, strict=True):
        rise = end.rise(left)
        moved = end.point.reduced.columns @ (there - end.at)
        slope, square = 2 * float(end.point.reduced.residuals @ moved), float(moved @ moved)
        values.append(rise)
        reached = square > (0.25 * reach) ** 2 * end.found.scale
        bent.append((rise * end.found.scale - slope) / square if reached else np.nan)
    loadings = dict(zip(end.entries, end.directions.loadings[:, direction].tolist(), strict=True))
    ahead = end.point.reduced.columns @ move
    shift = -float(end.point.reduced.residuals @ ahead) / float(ahead @ ahead)
    return Slice(direction, loadings, tuple(reaches), tuple(values), tuple(bent), shift)


def _joined(far: Slice, near: Slice) -> Slice:
    """One slice of the points of both, from the lowest reach to the highest."""
    rows = zip((*far.reaches, *near.reaches), (*far.values, *near.values), (*far.bent, *near.bent), strict=True)
    reaches, values, bent = zip(*sorted(rows, key=lambda row: row[0]), strict=True)
    return dataclasses.replace(far, reaches=reaches, values=values, bent=bent)
