"""Regressions on the equation of motion, with every term seen through the same smooth kernel."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import minimum_filter1d
from scipy.signal import fftconvolve

from ..estimation import LeastSquares, clustered_errors, huber_weights, least_squares, robust_deviation
from ..plants import MechanicalActuator
from . import _limits as limits
from ._filters import Samples
from ._motion import MotionRecord, plain_friction
from ._result import NotPossible


@dataclasses.dataclass(frozen=True, eq=False)
class Filtered:
    """Every term of the equation of motion through the same kernel, arrays of shape `(time,)`.

    A linear equation holds between them as it does between the signals, however wide the kernel: nothing is
    differentiated but the kernel. `force` in N, `position` in m, `velocity` in m/s, `acceleration` in m/s2; `direction`
    is the smoothed sign of motion, 0 where it is not certain. `valid` is false near both ends. `velocity_noise` in m/s
    and `acceleration_noise` in m/s2 are standard deviations.
    """

    motion: MotionRecord
    width: int
    force: Samples
    position: Samples
    velocity: Samples
    acceleration: Samples
    direction: Samples
    valid: Bool[np.ndarray, " time"]
    velocity_noise: float
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
        noise,
        motion.noise * float(np.linalg.norm(curve)),
    )


def through_kernel(filtered: Filtered, samples: Samples) -> Samples:
    """Another signal of the same motion through the kernel of `filtered`."""
    return _convolve(samples, _kernels(filtered.width // 2, filtered.motion.interval)[0])


def _kernels(half: int, interval: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The kernel over `2 half + 1` samples, which sums to one, and its first two derivatives with respect to time.

    Sums over samples are not integrals: left as they are, a position of 0.1 m shows as an acceleration. The derivatives
    are corrected to be exact on parabolas.
    """
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
    filtered[half : len(samples) - half] = fftconvolve(samples - middle, kernel, mode="valid")
    return filtered + middle * np.sum(kernel)


def within_stops(model: MechanicalActuator, motion: MotionRecord) -> Bool[np.ndarray, " time"]:
    """Where no stop touches the rod, wherever the closed one really is."""
    travel = float(model.diaphragm.travel)
    if not np.isfinite(travel):
        return np.ones(len(motion.time), dtype=bool)
    margin = max(travel * limits.STOP_MARGIN, limits.STOP_NOISE * motion.noise)
    end = min(travel, float(np.max(motion.position)))
    return (motion.position > margin) & (motion.position < end - margin)


def sliding(filtered: Filtered, inside: Bool[np.ndarray, " time"], distance: float) -> Bool[np.ndarray, " time"]:
    """Where a rod has slid one way for longer than a kernel.

    **Arguments:** `inside`: away from stops; `distance` in m after which friction has forgotten the last turn.
    """
    direction = filtered.direction
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    begin = np.zeros(len(direction), dtype=int)
    begin[turns] = turns
    since = np.abs(filtered.position - filtered.position[np.maximum.accumulate(begin)])
    slid = (direction != 0) & (since > distance) & inside & filtered.valid
    return minimum_filter1d(slid, filtered.width, mode="constant", cval=0).astype(bool)


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
    the unknowns alone; what is not determined is NaN. `scale` is the residuals' robust variance in N^2.
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
        found = least_squares(weighted, np.append(right * weights, np.zeros(len(unknown))), limits.INFLATION)
        residual = right - columns @ found.values
        deviation = max(robust_deviation(residual), 1e-9)
        if robust:
            weights = huber_weights(residual, deviation)
    left = np.append(residual * weights, np.full(len(unknown), scale))
    bunch = np.append(groups, np.max(groups) + 1 + np.arange(len(unknown)))
    errors = clustered_errors(left, weighted, bunch)
    determined = found.determined[:size]
    return dataclasses.replace(
        found,
        values=np.where(determined, found.values[:size], np.nan),
        covariance=np.diag(np.where(determined, errors[:size] ** 2, 0.0)),
        determined=determined,
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


# -- a rod that slides -------------------------------------------------------------------------------------------------

KERNEL = 0.1
"""s; between 0.05 and 0.2 s the bench traces give the same spring and friction within their errors."""


@dataclasses.dataclass(frozen=True, eq=False)
class Coefficients:
    """Values and standard errors of the terms of a law by name, in SI units; NaN for what is not determined."""

    values: dict[str, float]
    std_errors: dict[str, float]

    def relative_error(self, name: str) -> float:
        """Standard error over value, infinite where the value is not determined."""
        error = self.std_errors.get(name, np.nan) / abs(self.values.get(name, np.nan))
        return float(error) if np.isfinite(error) else np.inf

    def value(self, name: str) -> float:
        """A value, or zero where it is not determined."""
        value = self.values.get(name, 0.0)
        return 0.0 if np.isnan(value) else value


@dataclasses.dataclass(frozen=True, eq=False)
class Sliding(Coefficients):
    """The law of a sliding rod, `f = F_0 + k x + F_c s + drop s exp(-|v|/v_s) + b v + m a`, `s` the direction.

    Values are by those of the names `preload, stiffness, coulomb, drop, viscous, mass` that were asked for. Arrays of
    all rows: `force` in N, `position` in m, `velocity` in m/s, `acceleration` in m/s2.
    """

    force: Samples
    position: Samples
    velocity: Samples
    acceleration: Samples

    def friction(self) -> Samples:
        """What is left of the force without spring and inertia, in N."""
        spring = self.value("preload") + self.value("stiffness") * self.position
        return self.force - spring - self.value("mass") * self.acceleration


def fit_sliding(
    model: MechanicalActuator, motions: Sequence[MotionRecord], stribeck_velocity: float | None = None
) -> Sliding:
    """Fits the law to all stretches over which the rod slides one way between the stops.

    **Arguments:** `stribeck_velocity`: `v_s` in m/s of the term that it belongs to; no such term without it.

    **Raises:** `NotPossible` when there are none.
    """
    seen = [filter_motion(motion, KERNEL) for motion in motions]
    friction, spring = plain_friction(model), float(model.diaphragm.stiffness) > 0
    bristles = getattr(friction, "bristle_stiffness", None)
    distance = 0.0 if bristles is None else limits.MEMORY * float(friction.coulomb_force) / float(bristles)
    chosen = [sliding(each, within_stops(model, each.motion), distance) for each in seen]
    if sum(np.count_nonzero(rows) for rows in chosen) < limits.SLIDING_SAMPLES:
        raise NotPossible(
            "the rod never slides freely between its stops; record motion through the middle of its travel"
        )
    blocks, names = [], list(_columns(seen[0], spring, stribeck_velocity))
    for each, rows in zip(seen, chosen, strict=True):
        columns = _columns(each, spring, stribeck_velocity)
        doubt = each.motion.constant_error(float(model.diaphragm.stiffness))
        matrix = np.stack([column[rows] for column in columns.values()], axis=1)
        blocks.append(TraceEquations(matrix, each.force[rows], each.motion.time[rows], each.width, doubt))
    found = regress_traces([block for block in blocks if len(block.right)])

    def rows_of(name: str) -> Samples:
        return np.concatenate([getattr(each, name)[rows] for each, rows in zip(seen, chosen, strict=True)])

    return Sliding(
        dict(zip(names, found.values.tolist(), strict=True)),
        dict(zip(names, found.std_errors.tolist(), strict=True)),
        rows_of("force"),
        rows_of("position"),
        rows_of("velocity"),
        rows_of("acceleration"),
    )


def _columns(filtered: Filtered, spring: bool, stribeck_velocity: float | None) -> dict[str, Samples]:
    """What the unknowns of the law multiply."""
    columns = {"preload": np.ones(len(filtered.force))}
    if spring:
        columns["stiffness"] = filtered.position
    columns["coulomb"] = filtered.direction
    if stribeck_velocity is not None:
        columns["drop"] = filtered.direction * np.exp(-np.abs(filtered.velocity) / stribeck_velocity)
    return columns | {"viscous": filtered.velocity, "mass": filtered.acceleration}


def at_closed_stop(
    motion: MotionRecord, preload: float, stiffness: float, friction: float
) -> Bool[np.ndarray, " time"]:
    """Samples at rest in the farther half of the motion whose drive friction and spring can't balance (N, N/m, N)."""
    seen = filter_motion(motion, KERNEL)
    excess = seen.force - preload - stiffness * seen.position
    middle = 0.5 * (np.max(motion.position) + np.min(motion.position))
    return seen.valid & (seen.direction == 0) & (excess > limits.HELD_FORCE * friction) & (seen.position > middle)
