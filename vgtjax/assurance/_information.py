"""What traces can tell of the parameters, before anything is fitted: Fisher's information in scaled coordinates."""

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..estimation import (
    FAINT,
    Calibrator,
    Computation,
    LeastSquares,
    Task,
    by_gains,
    least_squares,
    run_alone,
    uncertain_gains,
)
from ..identification import starting_fit

NOTHING = "these traces determine none of the free parameters"
LARGE_ERROR = 0.3
"""Relative standard error from which a direction is nearly null: such a value says hardly more than its order."""
CARRIES = 0.3
"""Part of the largest loading from which an entry carries a nearly null direction."""
PART_OF_NULL = 1e-3
"""Part of the largest loading from which an entry belongs to a null direction: rounding leaves 1e-6."""
MOST_STEPS = 6
"""Steps of a search towards the traces: what they tell depends on where one stands, and the start may be far off."""
CHI2_MET = 1.2
"""chi^2 per measurement below which a model meets its traces."""
ERROR_FALL = 5.0
"""Factor between errors at the start and where steps have led from which the start counts: on slow loops alone a search
met the traces where the rod sticks and slips, and mass seemed known to 10 %; at the true values it is to 190 %."""

Columns = Float[np.ndarray, "rows entries"]


@dataclasses.dataclass(frozen=True, eq=False)
class Information:
    """What traces tell of the free entries of a model at some values.

    `columns` are derivatives of the signals in units of the sensors' noise, in few rows, without what offsets of
    sensors explain; with respect to the logarithms of positive entries, and to the others in units of their size. So
    errors are relative. What is known of entries beforehand is a row for each. `moving` has in the same rows how the
    signals change where what is taken for granted, as the gain of a sensor or what is held with a tolerance, is off by
    its standard uncertainty.
    """

    entries: Sequence[str]
    values: Float[np.ndarray, " entries"]
    columns: Columns
    moving: Float[np.ndarray, "rows granted"] | None = None

    @staticmethod
    def by(entries: Sequence[str], values: Float[np.ndarray, " entries"], rows: np.ndarray) -> "Information":
        """By rows that have `moving` behind the columns; one that is no number, or no more than rounding, tells
        nothing."""
        usable = np.where(np.all(np.isfinite(rows), axis=0), rows, 0.0)
        usable[:, np.linalg.norm(usable, axis=0) < FAINT] = 0.0
        triangle = np.asarray(np.linalg.qr(usable, mode="r"))
        return Information(entries, values, triangle[:, : len(entries)], triangle[:, len(entries) :])

    @property
    def rows(self) -> np.ndarray:
        """Columns, and behind them what is `moving`."""
        moving = np.zeros((len(self.columns), 0)) if self.moving is None else self.moving
        return np.column_stack([self.columns, moving])

    def with_more(self, rows: np.ndarray) -> "Information":
        """What these rows, of derivatives and what is `moving`, tell besides."""
        return Information.by(self.entries, self.values, np.vstack([self.rows, rows]))

    @functools.cached_property
    def solved(self) -> LeastSquares:
        """The linear problem of these columns."""
        return least_squares(self.columns, np.zeros(len(self.columns)))

    @property
    def errors(self) -> dict[str, float]:
        """Expected relative standard error of every entry, by noise and by what is taken for granted; infinite for what
        is not estimable."""
        moving = self.rows[:, len(self.entries) :].T
        moved = [least_squares(self.columns, each).values for each in moving]
        errors = np.sqrt(np.sum(np.square([self.solved.std_errors, *moved]), axis=0))
        return dict(zip(self.entries, np.nan_to_num(errors, nan=np.inf).tolist(), strict=True))

    def summary(self) -> dict[str, Any]:
        """Groups and expected relative errors by name, `None` for what is not estimable."""
        return {
            "null": self.null + [[name] for name in self.without_effect],
            "nearly_null": [group for group, _ in self.nearly_null],
            "expected_relative_error": {
                name: error if np.isfinite(error) else None for name, error in self.errors.items()
            },
        }

    @property
    def tells(self) -> bool:
        """Whether any entry is estimable at all."""
        return any(np.isfinite(error) for error in self.errors.values())

    @property
    def without_effect(self) -> list[str]:
        """Entries that no trace depends on."""
        lengths = np.linalg.norm(self.columns, axis=0)
        return [name for name, length in zip(self.entries, lengths, strict=True) if length == 0.0]

    @property
    def null(self) -> list[list[str]]:
        """Groups of entries that can't be told apart: together they can change so that no signal does."""
        lengths = np.linalg.norm(self.columns, axis=0)
        felt = lengths > 0
        names = [name for name, is_felt in zip(self.entries, felt, strict=True) if is_felt]
        directions = least_squares(self.columns[:, felt], np.zeros(len(self.columns))).null_directions / lengths[felt]
        members = [np.flatnonzero(np.abs(row) > PART_OF_NULL) for row in _sparse(directions)]
        return [[names[place] for place in group] for group in sorted(members, key=len)]

    @property
    def nearly_null(self) -> list[tuple[list[str], float]]:
        """Groups of entries that hardly show, the least known first, and the relative error along their direction."""
        known = self.solved.estimable
        sizes, ways = np.linalg.eigh(self.solved.covariance[np.ix_(known, known)])
        names, found = np.array(self.entries)[known], []
        for size, way in zip(sizes[::-1], ways.T[::-1], strict=True):
            if size <= LARGE_ERROR**2:
                break
            loadings = np.abs(way)
            order = np.argsort(-loadings)
            group = [str(names[i]) for i in order if loadings[i] > CARRIES * loadings.max()]
            found.append((group, float(np.sqrt(size))))
        return found

    @property
    def granted(self) -> dict[str, float]:
        """Relative errors of entries that would be well known but for what is taken for granted."""
        by_noise = dict(zip(self.entries, self.solved.std_errors.tolist(), strict=True))
        large = {name: error for name, error in self.errors.items() if LARGE_ERROR < error < np.inf}
        return {name: error for name, error in large.items() if by_noise[name] <= LARGE_ERROR}

    @property
    def sentences(self) -> list[str]:
        """What these traces can't tell, in words."""
        idle = ", ".join(self.without_effect)
        said = [f"no trace depends on {idle}: excite what depends on it, or hold it"] if idle else []
        for group in self.null:
            way = "scale together" if len(group) > 2 else "can't be told apart"
            said.append(f"{', '.join(group)} {way}: measure one of them, and hold it")
        for group, error in self.nearly_null:
            way = "hardly shows" if len(group) == 1 else "hardly show apart from each other"
            said.append(f"{', '.join(group)} {way}: known to {100 * error:.0f} %")
        for name, error in self.granted.items():
            said.append(
                f"{name} is known to {100 * error:.0f} % only, by what gains of sensors and tolerances leave open: "
                "know these better"
            )
        return said


def _sparse(directions: Float[np.ndarray, "directions entries"]) -> Float[np.ndarray, "directions entries"]:
    """The same space by directions that share few entries: reduced rows, then multiples of others taken away where that
    leaves less. The largest entry of each is one."""
    rows = np.array(directions)
    taken = np.zeros(rows.shape[1:], bool)
    for place in range(len(rows)):
        rest = np.abs(rows[place:])
        rest[:, taken] = 0.0
        at, pivot = (int(each) for each in np.unravel_index(np.argmax(rest), rest.shape))
        rows[[place, place + at]] = rows[[place + at, place]]
        others = np.arange(len(rows)) != place
        rows[others] -= np.outer(rows[others, pivot] / rows[place, pivot], rows[place])
        taken[pivot] = True
        rows = rows / np.max(np.abs(rows), axis=1, keepdims=True)
    for _ in range(len(rows)):
        for place, other in itertools.permutations(range(len(rows)), 2):
            rows[place] = _lighter(rows[place], rows[other])
    return rows


def _lighter(row: Float[np.ndarray, " entries"], other: Float[np.ndarray, " entries"]) -> Float[np.ndarray, " entries"]:
    """A row less that multiple of another one which leaves the fewest entries."""
    shared = other[np.abs(other) > PART_OF_NULL], row[np.abs(other) > PART_OF_NULL]
    ways = [row, *(row - ratio * other for ratio in np.unique(np.round(shared[1] / shared[0], 9)))]
    ways = [each / max(np.max(np.abs(each)), 1e-300) for each in ways]
    return min(ways, key=lambda each: np.count_nonzero(np.abs(each) > PART_OF_NULL))


def informing(calibrator: Calibrator) -> Computation[Information]:
    """What is known where a calibration stands, as a computation; noise is white, of the size that the signals show."""
    search, task = calibrator.minimiser, calibrator.task
    problem, entries = search.problem, task.selection.entries
    count, at = len(entries), search.slopes.at
    values = np.asarray(calibrator.transform.to_physical(np.asarray(search.progress.coordinates)))[:count]
    parts = [problem.columns_of(search.slopes.columns, at)[:, :count]]
    if uncertain_gains(task):
        parts.append(problem.whitened([by_gains(task, lanes) for lanes in search.slopes.evaluated.observed]))
    if task.tolerances:
        held = yield from search.slopes.held(problem, list(task.tolerances))
        parts.append(problem.whitened(held)[:, : len(task.tolerances)] * list(task.tolerances.values()))
    rows = np.column_stack(parts)
    if problem.prior is not None:
        before = np.zeros((count, rows.shape[1]))
        before[:, :count] = np.diag(problem.prior.precision[:count])
        rows = np.vstack([rows, before])
    return Information.by(entries, values, rows)


def examine(task: Task) -> Information:
    """What the traces of a task can tell.

    **Raises:** `SimulationError` when the start can't be simulated.
    """
    return run_alone(examining(task))


def examining(task: Task) -> Computation[Information]:
    """`examine` as a computation: at the start, or where a few steps lead that meet the traces."""
    calibrator = yield from starting_fit(task)
    search, start = calibrator.minimiser, (yield from informing(calibrator))
    while 2 * search.progress.cost > CHI2_MET:
        if search.progress.finished or search.progress.iteration >= MOST_STEPS:
            return start
        yield from search.steps()
    moved = yield from informing(calibrator)
    return start if _astray(start, moved) else moved


def _astray(start: Information, moved: Information) -> bool:
    """Whether something that hardly shows at the start seems well known."""
    return any(
        before > LARGE_ERROR and after < before / ERROR_FALL
        for before, after in zip(start.errors.values(), moved.errors.values(), strict=True)
    )
