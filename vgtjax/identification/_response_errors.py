"""Standard errors of the fitted response of the mechanical half: correlated residuals, offsets, noise of the drive."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..estimation import CHANNELS, SEGMENT, Calibrator, clustered_gram, least_squares, start_calibration
from . import _limits as limits
from ._motion import MotionRecord, mechanical_half

EXPERIMENTS = 5
"""Of fresh noise on the drive; with five, a standard error from five traces is good to a seventh."""


def covariance(
    whole: Calibrator, motions: Sequence[MotionRecord], held: Bool[np.ndarray, " entries"]
) -> Float[np.ndarray, "entries entries"]:
    """Covariance of the coordinates, with all that makes fitted values wrong: correlated residuals, unknown offsets of
    the pressure, held parameters."""
    residuals, columns = whole.minimiser.linearisation()
    sprung = float(mechanical_half(whole.task.model).diaphragm.stiffness) > 0
    owner, block = _layout(whole, motions, limits.CORRELATION if sprung else limits.CORRELATION_FREE)
    bread = _bread(columns, held)
    white = columns.T @ columns * max(residuals @ residuals / whole.minimiser.problem.count, 1.0)
    clustered = clustered_gram(residuals, columns, block)
    shifts = np.diag(np.where(held, 1 / limits.ERROR_RESPONSE**2, 0.0))
    if "diaphragm.preload" in (entries := list(whole.task.selection.entries)):
        at = entries.index("diaphragm.preload")
        per_newton = columns[:, at] / whole.transform.scale[at]
        for number, motion in enumerate(motions):
            shift = columns.T @ (per_newton * (owner == number)) * motion.force_error
            shifts = shifts + np.outer(shift, shift)
    worst = [bread @ (noise + shifts) @ bread for noise in (white, clustered)]
    usual = np.diag(worst[0])
    # A sum of squares below zero is rounding of columns without end, which tell nothing.
    larger = np.where(usual >= 0, np.maximum(usual, np.diag(worst[1])), np.nan)
    grow = np.sqrt(larger / np.maximum(usual, 1e-300))
    return worst[0] * np.outer(grow, grow)


def drive_variances(
    whole: Calibrator, motions: Sequence[MotionRecord], held: Bool[np.ndarray, " entries"]
) -> Float[np.ndarray, " entries"]:
    """Variances of the coordinates from noise of the drive that its smoothing lets through, by experiment."""
    noisy = [number for number, motion in enumerate(motions) if motion.drive_noise > 0]
    residuals, columns = whole.minimiser.linearisation()
    bread, owner = _bread(columns, held), _layout(whole, motions, limits.CORRELATION)[0]
    variances, random = np.zeros(columns.shape[1]), np.random.default_rng(0)
    for _ in range(EXPERIMENTS if noisy else 0):
        traces = [motion.with_fresh_noise(random).trace for motion in motions]
        task = dataclasses.replace(whole.task, fit=traces)
        change = start_calibration(task).minimiser.linearisation()[0] - residuals
        moves = [bread @ (columns.T @ (change * (owner == number))) for number in noisy]
        variances += np.sum(np.square(moves), axis=0) / EXPERIMENTS
    return variances


def _bread(columns: np.ndarray, held: Bool[np.ndarray, " entries"]) -> np.ndarray:
    """Inverse of the normal equations, in which held entries may be wrong by `ERROR_RESPONSE`."""
    prior = np.diag(np.where(held, 1 / limits.ERROR_RESPONSE, 0.0))
    return least_squares(np.vstack([columns, prior]), np.zeros(len(columns) + len(prior))).covariance


def _layout(whole: Calibrator, motions: Sequence[MotionRecord], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The trace, and the stretch of so many seconds, of every residual."""
    owners, blocks, first = [], [], 0
    problem, channels = whole.minimiser.problem, len(CHANNELS)
    for bundle in problem.bundles:
        trace = np.asarray(bundle.indices)[bundle.lane_trace]
        interval = np.array([motion.interval for motion in motions])[trace]
        lanes = np.maximum(np.round(seconds / (SEGMENT * interval)), 1.0)
        key = np.stack([trace, np.floor(bundle.lane_segment / lanes).astype(int)])
        number = np.unique(key, axis=1, return_inverse=True)[1].reshape(-1)
        owners.append(np.repeat(trace, SEGMENT * channels))
        blocks.append(np.repeat(first + number, SEGMENT * channels))
        first += int(number.max()) + 1
    return np.concatenate(owners), np.concatenate(blocks)
