"""A trace as the motion of a mass under a force, seen through smooth kernels, and regressions on it."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solveh_banded
from scipy.ndimage import minimum_filter1d
from scipy.signal import fftconvolve
from scipy.sparse import csr_array, dia_array

from ..actuator import Actuator
from ..estimation.noise import noise_level
from ..mechanical import MechanicalActuator
from ..model import AbstractModel
from ..trace import SENSOR_PRESSURE_OFFSET, START_WINDOW, Trace
from .filters import Samples, resting
from .regression import clustered_errors

STOP_DOUBT = 0.1
"""Part of the stop's stiffness by which the assumed one may be wrong: it says how far preload presses the rod in."""
UNKNOWN_POSITION = 0.25e-3
"""m; standard error of the offset of a position sensor that was never seen at a known place."""
CERTAIN = 5.0
"""Standard deviations of velocity noise beyond which a rod certainly moves."""
BLOCK = 0.25
"""s; residuals farther apart are taken for independent: friction and smoothed noise are alike over shorter times."""


# -- the pressure, free of noise ---------------------------------------------------------------------------------------

CREASE, FLAT, ROUGH = 0.6, 1.6e-5, 10.0
"""What a corner of the pressure costs, in units of its log-likelihood, below which size (in units of the noise) there is
none, and the weight of the convex first pass. On simulated bench traces 0.35 to 0.7, 1.6e-5 to 5e-5 and 10 to 100 leave
8 to 14 Pa of 60."""
PASSES = (15, 30)


def remove_noise(samples: Samples, noise: float) -> Samples:
    """The signal through evenly sampled noisy ones that consists of as few parabolas as the noise allows.

    The mechanical model is driven by a measured pressure. Its noise shakes the rod, which then creeps where friction
    would hold it: fitted on raw pressure, mass is 7 % off and stiction without bounds. Windows of one length either
    leave too much noise, or round the corner after a duty step and then the mass is off by half. Third differences
    with a penalty that grows with the logarithm of their size (after Candes, Wakin and Boyd, 2008) have long parabolas
    between corners wherever those are.

    **Arguments:** `noise`: standard deviation of the white noise.
    """
    count = len(samples) - 3
    if count < 5 or noise <= 0:
        return samples
    scaled = samples / noise
    stencil = np.broadcast_to(np.array([[-1.0], [3.0], [-3.0], [1.0]]), (4, len(samples)))
    differences = dia_array((stencil, range(4)), shape=(count, len(samples))).tocsr()
    smooth = _penalised(scaled, differences, np.full(count, 1e4 * ROUGH))
    for _ in range(PASSES[0]):
        size = np.abs(differences @ smooth)
        smooth = _penalised(scaled, differences, ROUGH / np.hypot(size, 0.1 * np.median(size) + FLAT))
    for _ in range(PASSES[1]):
        smooth = _penalised(scaled, differences, CREASE / ((differences @ smooth) ** 2 + FLAT**2))
    return smooth * noise


def _penalised(samples: Samples, differences: csr_array, weights: np.ndarray) -> Samples:
    """Minimum of `|s - samples|^2 + sum(weights (differences s)^2)`."""
    gram = (differences.T @ differences.multiply(weights[:, None])).tocsr()
    bands = np.zeros((4, len(samples)))
    for offset in range(4):
        bands[3 - offset, offset:] = gram.diagonal(offset)
    bands[3] += 1.0
    return solveh_banded(bands, samples)


# -- one trace ---------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """One trace in the words of mechanics, arrays of shape `(time,)`.

    `time` in s, evenly spaced; the driving `force` along +x in N and the `position` in m, both without their sensors'
    offsets where rest tells them. `noise` is the standard deviation of one position in m, `force_error` and
    `position_error` are what remains unknown of the offsets. `trace` has the same input, without noise, for a
    simulation.
    """

    trace: Trace
    time: Samples
    force: Samples
    position: Samples
    noise: float
    force_error: float
    position_error: float
    rest: Bool[np.ndarray, " time"]

    @property
    def interval(self) -> float:
        """Time between two samples in s."""
        return float(self.time[1] - self.time[0])


def mechanical_half(model: AbstractModel) -> MechanicalActuator:
    """Diaphragm, friction and vanes of a model."""
    whole: Any = model
    return MechanicalActuator(whole.diaphragm, whole.friction, whole.vane_force, whole.air)


def read_motions(model: AbstractModel, traces: Sequence[Trace]) -> list[Motion]:
    """What the mechanical identifications see of traces; those without a drive or a position are left out."""
    usable = [trace for trace in traces if trace.x_d is not None and not (trace.p_act is None and trace.f_drive is None)]
    return [_read(mechanical_half(model), _even(trace)) for trace in usable]


def _even(trace: Trace) -> Trace:
    """The trace on evenly spaced times, which kernels need."""
    steps = np.diff(trace.time)
    step = float(np.median(steps))
    if np.all(np.abs(steps - step) < 0.01 * step):
        return trace
    time = trace.time[0] + step * np.arange(int((trace.time[-1] - trace.time[0]) / step) + 1)
    held = np.searchsorted(trace.time, time, side="right") - 1
    signals: dict[str, Any] = {
        name: None if getattr(trace, name) is None else np.interp(time, trace.time, getattr(trace, name))
        for name in ("p_act", "p_res", "p_trb", "x_d", "f_vane", "f_drive")
    }
    pwm = None if trace.pwm is None else trace.pwm[held]
    return dataclasses.replace(trace, time=time, pwm=pwm, **signals)


def _read(model: MechanicalActuator, trace: Trace) -> Motion:
    assert trace.x_d is not None
    noise = noise_level(trace.x_d, "x_d")
    time = trace.time[0] + (trace.time[-1] - trace.time[0]) / (len(trace.time) - 1) * np.arange(len(trace.time))
    if trace.f_drive is not None:
        # A force that a command states has no noise to remove, and often jumps.
        rest = np.zeros(len(time), dtype=bool)
        return Motion(trace, time, trace.f_drive, trace.x_d, noise, 0.0, UNKNOWN_POSITION, rest)
    assert trace.p_act is not None
    rest = _resting(model, trace)
    pressure_noise = noise_level(trace.p_act, "p_act")
    pressure = remove_noise(trace.p_act, pressure_noise)
    area, count = float(model.diaphragm.area), int(np.sum(rest))
    if count == 0:
        offset, place, position_error, pressure_error = 0.0, 0.0, UNKNOWN_POSITION, 0.5 * SENSOR_PRESSURE_OFFSET
    else:
        offset, pressure_error = float(np.mean(trace.p_act[rest])) - trace.atmosphere, pressure_noise / np.sqrt(count)
        pressed = float(model.diaphragm.rest_position(np.asarray(0.0)))
        place = float(np.mean(trace.x_d[rest])) - pressed
        position_error = float(np.hypot(noise / np.sqrt(count), STOP_DOUBT * pressed))
    # The simulation counts pressure from the model's own ambient, as the trace does.
    clean = dataclasses.replace(trace, p_act=pressure - offset)
    ambient = float(model.air.pressure) + float(trace.drive().ambient_shift[0])
    force = (ambient - (trace.p_act - offset)) * area
    return Motion(clean, time, force, trace.x_d - place, noise, area * pressure_error, position_error, rest)


def _resting(model: MechanicalActuator, trace: Trace) -> Bool[np.ndarray, " time"]:
    """Samples at the start of a trace at which the chamber is at atmosphere and the rod on its open stop."""
    if trace.pwm is not None:
        # Which duty closes the valve hardly differs between valves; half of it is margin enough.
        return resting(Actuator(diaphragm=model.diaphragm), trace)
    return (trace.time <= trace.time[0] + START_WINDOW) & bool(trace.start().at_rest)


# -- through kernels ---------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, eq=False)
class Filtered:
    """Every term of the equation of motion through the same kernel, arrays of shape `(time,)`.

    A linear equation holds between them as it does between the signals, however wide the kernel: nothing is
    differentiated but the kernel. `force` in N, `position` in m, `velocity` in m/s, `acceleration` in m/s2; `direction`
    is the smoothed sign of motion, 0 where it is not certain. `valid` is false near both ends. `velocity_noise` in m/s
    and `acceleration_noise` in m/s2 are standard deviations.
    """

    motion: Motion
    width: int
    force: Samples
    position: Samples
    velocity: Samples
    acceleration: Samples
    direction: Samples
    valid: Bool[np.ndarray, " time"]
    velocity_noise: float
    acceleration_noise: float


def filter_motion(motion: Motion, seconds: float) -> Filtered:
    """A motion through the kernel `(1 - u^2)^4` that is `seconds` long, but never shorter than nine samples."""
    half = max(round(0.5 * seconds / motion.interval), 4)
    u = np.arange(-half, half + 1) / (half + 1)
    reach, rest = (half + 1) * motion.interval, 1 - u**2
    smooth, slope, curve = rest**4, -8 * u * rest**3 / reach, (48 * u**2 * rest**2 - 8 * rest**3) / reach**2
    area = np.sum(smooth)
    valid = np.zeros(len(motion.time), dtype=bool)
    valid[half : len(valid) - half] = True
    velocity, noise = _convolve(motion.position, slope / area), motion.noise * float(np.linalg.norm(slope / area))
    moving = np.sign(velocity) * (np.abs(velocity) > CERTAIN * noise) * valid
    return Filtered(
        motion,
        2 * half + 1,
        _convolve(motion.force, smooth / area),
        _convolve(motion.position, smooth / area),
        velocity,
        _convolve(motion.position, curve / area),
        moving,
        valid,
        noise,
        motion.noise * float(np.linalg.norm(curve / area)),
    )


def _convolve(samples: Samples, kernel: np.ndarray) -> Samples:
    """Same length; of no use within half a kernel of the ends. A constant is taken out for the sake of rounding."""
    middle = float(np.mean(samples))
    filtered = np.zeros(len(samples))
    if len(samples) < len(kernel):
        return filtered
    half = len(kernel) // 2
    filtered[half : len(samples) - half] = fftconvolve(samples - middle, kernel, mode="valid")
    return filtered + middle * np.sum(kernel)


def within_stops(model: MechanicalActuator, motion: Motion) -> Bool[np.ndarray, " time"]:
    """Where no stop touches the rod: a fiftieth of the travel away from both, wherever the closed one turns out to be."""
    travel = float(model.diaphragm.travel)
    if not np.isfinite(travel):
        return np.ones(len(motion.time), dtype=bool)
    margin = max(travel / 50, 10 * motion.noise)
    end = min(travel, float(np.max(motion.position)))
    return (motion.position > margin) & (motion.position < end - margin)


def sliding(
    filtered: Filtered, inside: Bool[np.ndarray, " time"], distance: float
) -> tuple[Bool[np.ndarray, " time"], Samples]:
    """Where a rod has slid one way for longer than a kernel, and how far in m since it last turned.

    **Arguments:** `distance`: in m, after which friction has forgotten the turn.
    """
    direction = filtered.direction
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    begin = np.zeros(len(direction), dtype=int)
    begin[turns] = turns
    since = np.abs(filtered.position - filtered.position[np.maximum.accumulate(begin)])
    slid = (direction != 0) & (since > distance) & inside & filtered.valid
    return minimum_filter1d(slid, filtered.width, mode="constant", cval=0).astype(bool), since


# -- regression --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """Equations from one trace: `matrix` times the unknowns is `right`, both in N.

    `time` in s, `overlap` of how many neighbours a row is the average, `constant` the standard error in N of a
    constant that the trace leaves unknown.
    """

    matrix: Float[np.ndarray, "rows unknowns"]
    right: Float[np.ndarray, " rows"]
    time: Float[np.ndarray, " rows"]
    overlap: int
    constant: float


@dataclasses.dataclass(frozen=True, eq=False)
class Regression:
    """`values` and `std_errors` of the unknowns, NaN for what was not determined; the `residual` in N, and its size."""

    values: Float[np.ndarray, " unknowns"]
    std_errors: Float[np.ndarray, " unknowns"]
    residual: Float[np.ndarray, " rows"]
    cost: float


ALONE = 1e-4
"""Part of a column that must not be a combination of the others."""


def regress(blocks: Sequence[Rows], robust: bool = True) -> Regression:
    """Least squares of all rows, with an unknown constant a trace, and errors that know of correlated residuals.

    Residuals beyond two robust deviations count by their absolute value (Huber), unless `robust` is false.
    """
    matrix, right, groups, traces = _stack(blocks)
    overlap, size = max(block.overlap for block in blocks), matrix.shape[1]
    doubt = np.array([block.constant for block in blocks])
    unknown = np.flatnonzero(doubt > 0)
    constants = (traces[:, None] == unknown[None, :]).astype(float)
    columns, deviation, weights = np.hstack([matrix, constants]), 1.0, np.ones(len(right))
    solution, residual = np.zeros(columns.shape[1]), right
    for step in range(8):
        # Neighbours share their samples: only the weight against what is known of the constants feels it.
        scale = deviation * np.sqrt(overlap)
        prior = np.diag(scale / doubt[unknown]) if step else np.eye(len(unknown)) * np.sqrt(len(right))
        known = np.hstack([np.zeros((len(unknown), size)), prior])
        weighted = np.vstack([columns * weights[:, None], known])
        solution = np.linalg.lstsq(weighted, np.append(right * weights, np.zeros(len(unknown))), rcond=1e-12)[0]
        residual = right - columns @ solution
        deviation = max(float(np.median(np.abs(residual))) / 0.6745, 1e-9)
        if robust:
            weights = np.sqrt(np.minimum(1.0, 2 * deviation / np.maximum(np.abs(residual), 1e-300)))
    left = np.append(residual * weights, np.full(len(unknown), scale))
    bunch = np.append(groups, np.max(groups) + 1 + np.arange(len(unknown)))
    errors = clustered_errors(left, weighted, bunch)[:size]
    lost = _dependent(weighted)[:size]
    cost = float(np.sum((residual * weights) ** 2)) / len(right)
    return Regression(np.where(lost, np.nan, solution[:size]), np.where(lost, np.nan, errors), residual, cost)


def _stack(blocks: Sequence[Rows]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All rows, the quarter of a second that each belongs to, and its trace."""
    groups, first = [], 0
    for block in blocks:
        own = np.unique(np.floor(block.time / BLOCK), return_inverse=True)[1]
        groups.append(first + own)
        first += int(np.max(own, initial=-1)) + 1
    traces = np.repeat(np.arange(len(blocks)), [len(block.right) for block in blocks])
    matrix = np.concatenate([block.matrix for block in blocks])
    return matrix, np.concatenate([block.right for block in blocks]), np.concatenate(groups), traces


def _dependent(columns: np.ndarray) -> Bool[np.ndarray, " unknowns"]:
    """Which columns are zero, or combinations of the others."""
    lengths = np.linalg.norm(columns, axis=0)
    lost = lengths <= 1e-9 * np.max(lengths, initial=1e-300)
    unit = columns[:, ~lost] / lengths[~lost]
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-13)
    lost[~lost] = 1 / np.maximum(np.diag(inverse), 1e-300) < ALONE**2
    return lost
