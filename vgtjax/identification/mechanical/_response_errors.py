"""Standard errors of the fitted response of the mechanical half: correlated residuals, offsets, noise of the drive."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...estimation import (
    CHANNELS,
    SEGMENT,
    Calibrator,
    FitProblem,
    Task,
    build_fit_problem,
    clustered_gram,
    least_squares,
    misfit_at,
    run_alone,
    side_by_side,
    start_calibration,
)
from ...parameters import Transform, build_transform, parameter_table
from .. import _limits as limits
from ._motion import MotionRecord, mechanical_half

EXPERIMENTS = 5
"""Of fresh noise on the drive; with five, a standard error from five traces is good to a seventh."""


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseColumns:
    """A fit where it ended, with nothing held: residuals in units of the noise, and their derivatives with respect to
    the coordinates of `transform`.

    `task` begins at the fitted values; `rows` are those of the problem's residuals that measure something, the only
    ones here.
    """

    task: Task
    problem: FitProblem
    transform: Transform
    motions: Sequence[MotionRecord]
    rows: Bool[np.ndarray, " all"]
    residuals: Float[np.ndarray, " rows"]
    columns: Float[np.ndarray, "rows entries"]

    @functools.cached_property
    def triangle(self) -> Float[np.ndarray, "entries entries"]:
        """As many rows as there are columns, with the same products of columns."""
        return np.asarray(np.linalg.qr(self.columns, mode="r"))

    @functools.cached_property
    def owner(self) -> np.ndarray:
        """The number of the motion of every row."""
        return self.problem.owner[self.rows]

    def by_row(self, lanes: np.ndarray) -> np.ndarray:
        """What is known of every lane, for every row."""
        return np.repeat(lanes, SEGMENT * len(CHANNELS))[self.rows]


def linearise(calibrator: Calibrator, motions: Sequence[MotionRecord]) -> ResponseColumns:
    """A fit of motions linearised where it ended, with nothing held."""
    task, found = calibrator.task, np.asarray(calibrator.minimiser.progress.coordinates)
    values = np.asarray(calibrator.transform.to_physical(found))
    task = dataclasses.replace(task, model=task.selection.unpack(task.model, values), bounds={})
    residuals, columns = calibrator.minimiser.linearisation()
    if not np.all(np.any(columns != 0, axis=0)):  # what is held has no derivatives there
        calibrator = start_calibration(task)
        residuals, columns = calibrator.minimiser.linearisation()
    transform = build_transform(parameter_table(task.model), task.selection.entries, values, {})
    here, there = (each.slope(np.asarray(each.to_coordinates(values))) for each in (transform, calibrator.transform))
    rows = (residuals != 0) | np.any(columns != 0, axis=1)
    columns = columns[rows] * (np.asarray(here) / np.asarray(there))
    return ResponseColumns(task, calibrator.minimiser.problem, transform, motions, rows, residuals[rows], columns)


def covariance(whole: ResponseColumns, held: Bool[np.ndarray, " entries"]) -> Float[np.ndarray, "entries entries"]:
    """Covariance of the coordinates, with all that makes fitted values wrong: correlated residuals, unknown offsets of
    the pressure, held parameters."""
    residuals, columns = whole.residuals, whole.columns
    sprung = float(mechanical_half(whole.task.model).diaphragm.stiffness) > 0
    block = _blocks(whole, limits.CORRELATION if sprung else limits.CORRELATION_FREE)
    bread = _bread(whole, held)
    white = whole.triangle.T @ whole.triangle * max(residuals @ residuals / whole.problem.count, 1.0)
    clustered = clustered_gram(residuals, columns, block)
    shifts = np.diag(np.where(held, 1 / limits.ERROR_RESPONSE**2, 0.0))
    if "diaphragm.preload" in (entries := list(whole.task.selection.entries)):
        at = entries.index("diaphragm.preload")
        per_newton = columns[:, at] / whole.transform.scale[at]
        for number, motion in enumerate(whole.motions):
            shift = columns.T @ (per_newton * (whole.owner == number)) * motion.force_error
            shifts = shifts + np.outer(shift, shift)
    worst = [bread @ (noise + shifts) @ bread for noise in (white, clustered)]
    usual = np.diag(worst[0])
    # A sum of squares below zero is rounding of columns without end, which tell nothing.
    larger = np.where(usual >= 0, np.maximum(usual, np.diag(worst[1])), np.nan)
    grow = np.sqrt(larger / np.maximum(usual, 1e-300))
    return worst[0] * np.outer(grow, grow)


def drive_variances(whole: ResponseColumns, held: Bool[np.ndarray, " entries"]) -> Float[np.ndarray, " entries"]:
    """Variances of the coordinates from noise of the drive that its smoothing lets through, by experiment."""
    noisy = [number for number, motion in enumerate(whole.motions) if motion.drive_noise > 0]
    bread, task = _bread(whole, held), whole.task
    values = task.selection.values(task.model)
    here = np.asarray(whole.transform.to_coordinates(values))
    problems = [
        build_fit_problem(
            task.model,
            task.selection,
            whole.transform,
            [motion.measured_again(experiment) for motion in whole.motions],
            channels=task.channels,
            stepping=task.stepping,
        )
        for experiment in range(EXPERIMENTS if noisy else 0)
    ]
    variances = np.zeros(len(values))
    for residuals in run_alone(side_by_side([misfit_at(problem, here) for problem in problems])):
        if residuals is None:  # nothing can be told of noise with which nothing can be simulated
            return np.full(len(values), np.inf)
        change = residuals[whole.rows] - whole.residuals
        moves = [bread @ (whole.columns.T @ (change * (whole.owner == number))) for number in noisy]
        variances += np.sum(np.square(moves), axis=0) / EXPERIMENTS
    return variances


def _bread(whole: ResponseColumns, held: Bool[np.ndarray, " entries"]) -> np.ndarray:
    """Inverse of the normal equations, in which held entries may be wrong by `ERROR_RESPONSE`."""
    prior = np.diag(np.where(held, 1 / limits.ERROR_RESPONSE, 0.0))
    rows = np.vstack([whole.triangle, prior])
    return least_squares(rows, np.zeros(len(rows))).covariance


def _blocks(whole: ResponseColumns, seconds: float) -> np.ndarray:
    """The stretch of so many seconds of every row."""
    blocks, first = [], 0
    for bundle in whole.problem.bundles:
        trace = np.asarray(bundle.indices)[bundle.lane_trace[: bundle.owned]]
        interval = np.array([motion.interval for motion in whole.motions])[trace]
        lanes = np.maximum(np.round(seconds / (SEGMENT * interval)), 1.0)
        key = np.stack([trace, np.floor(bundle.lane_segment[: bundle.owned] / lanes).astype(int)])
        number = np.unique(key, axis=1, return_inverse=True)[1].reshape(-1)
        blocks.append(first + number)
        first += int(number.max()) + 1
    return whole.by_row(np.concatenate(blocks))
