"""Regressions on the equation of motion, with every term seen through the same smooth kernel."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Bool, Float

from ...estimation import LeastSquares, clustered_errors, huber_weights, least_squares, reduce_rows
from ...plants import MechanicalActuator
from ...traces import robust_deviation
from .. import _limits as limits
from .._filters import Samples
from ._motion import MotionRecord


@dataclasses.dataclass(frozen=True, eq=False)
class Filtered:
    """Every term of the equation of motion through the same kernel, arrays of shape `(time,)`.

    `force` in N, `position` in m, `velocity` in m/s, `acceleration` in m/s2; `direction` is the smoothed sign of
    motion, 0 where it is not certain. `valid` is false near both ends. `acceleration_noise` in m/s2
    is a standard deviation.
    """

    motion: MotionRecord
    width: int
    force: Samples
    position: Samples
    velocity: Samples
    acceleration: Samples
    direction: Samples
    valid: Bool[np.ndarray, " time"]
    acceleration_noise: float


def filter_motion(motion: MotionRecord, seconds: float) -> Filtered:
    """A motion through the kernel `(1 - u^2)^4` that is `seconds` long, but never shorter than nine samples."""
    half = max(round(0.5 * seconds / motion.interval), 4)
    smooth, slope, curve = _kernels(half, motion.interval)
    valid = np.zeros(len(motion.time), dtype=bool)
    valid[half : len(valid) - half] = True
    velocity, noise = _convolve(motion.position, slope), motion.noise * float(np.linalg.norm(slope))
    moving = np.sign(velocity) * (np.abs(velocity) > limits.MOVING * noise) * valid
    return Filtered(
        motion,
        2 * half + 1,
        _convolve(motion.force, smooth),
        _convolve(motion.position, smooth),
        velocity,
        _convolve(motion.position, curve),
        moving,
        valid,
        motion.noise * float(np.linalg.norm(curve)),
    )


def through_kernel(filtered: Filtered, samples: Samples) -> Samples:
    """Another signal of the same motion through the kernel of `filtered`."""
    return _convolve(samples, _kernels(filtered.width // 2, filtered.motion.interval)[0])


def _kernels(half: int, interval: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The kernel over `2 half + 1` samples, which sums to one, and its first two derivatives with respect to time,
    corrected to be exact on parabolas."""
    u = np.arange(-half, half + 1) / (half + 1)
    time, rest = u * (half + 1) * interval, 1 - u**2
    smooth = rest**4 / np.sum(rest**4)
    slope, curve = u * rest**3, 6 * u**2 * rest**2 - rest**3
    curve = curve - np.sum(curve) * smooth
    # Convolution turns a kernel round: a rising signal meets a kernel that falls.
    return smooth, -slope / np.sum(slope * time), 2 * curve / np.sum(curve * time**2)


def _convolve(samples: Samples, kernel: np.ndarray) -> Samples:
    """Same length; of no use within half a kernel of the ends. A constant is taken out for the sake of rounding."""
    filtered = np.zeros(len(samples))
    if len(samples) < len(kernel):
        return filtered
    half, middle = len(kernel) // 2, float(np.mean(samples))
    filtered[half : len(samples) - half] = scipy.signal.fftconvolve(samples - middle, kernel, mode="valid")
    return filtered + middle * np.sum(kernel)


def within_stops(model: MechanicalActuator, motion: MotionRecord) -> Bool[np.ndarray, " time"]:
    """Where no stop touches the rod, wherever the closed one really is."""
    travel = float(model.diaphragm.travel)
    if not np.isfinite(travel):
        return np.ones(len(motion.time), dtype=bool)
    margin = max(travel * limits.STOP_MARGIN, limits.STOP_NOISE * motion.noise)
    end = min(travel, float(np.max(motion.position)))
    return (motion.position > margin) & (motion.position < end - margin)


@dataclasses.dataclass(frozen=True, eq=False)
class TraceEquations:
    """Equations from one trace: `matrix` times the unknowns is `right`, both in N.

    `time` in s, `overlap` of how many neighbours a row is the average, `constant` the standard error in N of a
    constant that the trace leaves unknown.
    """

    matrix: Float[np.ndarray, "rows unknowns"]
    right: Float[np.ndarray, " rows"]
    time: Float[np.ndarray, " rows"]
    overlap: int
    constant: float


def regress_traces(blocks: Sequence[TraceEquations], robust: bool = True) -> LeastSquares:
    """Least squares of all rows, with an unknown constant per trace, and errors that know of correlated residuals.

    Residuals beyond two robust deviations count by their size (Huber), unless `robust` is false. Values are those of
    the unknowns alone; what is not estimable is NaN. `scale` is the residuals' robust variance in N^2.
    """
    matrix, right, groups, traces = _stack(blocks)
    overlap, size = max(block.overlap for block in blocks), matrix.shape[1]
    doubt = np.array([block.constant for block in blocks])
    unknown = np.flatnonzero(doubt > 0)
    constants = (traces[:, None] == unknown[None, :]).astype(float)
    columns, deviation, weights = np.hstack([matrix, constants]), 1.0, np.ones(len(right))
    for step in range(8):
        # Neighbours share their samples: only the weight against what is known of the constants feels it.
        scale = deviation * np.sqrt(overlap)
        prior = np.diag(scale / doubt[unknown]) if step else np.eye(len(unknown)) * np.sqrt(len(right))
        known = np.hstack([np.zeros((len(unknown), size)), prior])
        weighted = np.vstack([columns * weights[:, None], known])
        target = np.append(right * weights, np.zeros(len(unknown)))
        few, reduced = reduce_rows(target, weighted)
        found = least_squares(reduced, few, limits.INFLATION)
        residual = right - columns @ found.values
        deviation = max(robust_deviation(residual), 1e-9)
        if robust:
            weights = huber_weights(residual, deviation)
    left = np.append(residual * weights, np.full(len(unknown), scale))
    bunch = np.append(groups, np.max(groups) + 1 + np.arange(len(unknown)))
    errors = clustered_errors(left, weighted, bunch)
    estimable = found.estimable[:size]
    return dataclasses.replace(
        found,
        values=np.where(estimable, found.values[:size], np.nan),
        covariance=np.diag(np.where(estimable, errors[:size] ** 2, 0.0)),
        estimable=estimable,
        null_directions=found.null_directions[:, :size],
        scale=deviation**2,
    )


def _stack(blocks: Sequence[TraceEquations]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All rows, the quarter of a second that each belongs to, and its trace."""
    groups, first = [], 0
    for block in blocks:
        own = np.unique(np.floor(block.time / limits.CORRELATION), return_inverse=True)[1]
        groups.append(first + own)
        first += int(np.max(own, initial=-1)) + 1
    traces = np.repeat(np.arange(len(blocks)), [len(block.right) for block in blocks])
    matrix = np.concatenate([block.matrix for block in blocks])
    return matrix, np.concatenate([block.right for block in blocks]), np.concatenate(groups), traces
