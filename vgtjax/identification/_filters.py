"""Signals for identification: smoothing that keeps corners, derivatives, sensor offsets, and stretches of one duty."""

import dataclasses
import itertools

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from ..parts import Converter
from ..plants import AbstractModel, AbstractRodModel, converter_of
from ..traces import Trace, drift_of, noise_level
from . import _limits as limits

Samples = Float[np.ndarray, " time"]

WINDOWS = (0.011, 0.021, 0.041, 0.081, 0.161)
"""s; each twice the one before, from what a corner of a bench trace allows to where noise no longer matters."""
SHORTEST = 5
"""Samples; the least through which a cubic still averages."""
CONFIDENCE = 1.5
"""Standard deviations within which the windows must agree. On simulated traces 1.3 to 2 move no value by more than 1.3
standard errors; one fixed window moves the volume by six at 5 ms, through its noise, and by eight at 41 ms, through the
corners that it cuts."""
ORDER = 3


@dataclasses.dataclass(frozen=True, eq=False)
class Smooth:
    """A smoothed signal and its rate, each with the standard deviation that noise leaves, all of shape `(time,)`."""

    value: Samples
    rate: Samples
    value_error: Samples
    rate_error: Samples


def smooth(time: Samples, samples: Samples, noise: float) -> Smooth:
    """Local cubics (Savitzky and Golay), each over the longest window that agrees with all shorter ones.

    **Arguments:** `time` in s at any rate; `noise`: standard deviation of the white noise on `samples`.
    """
    step = float(np.median(np.diff(time)))
    if len(time) < SHORTEST:
        rate = np.gradient(samples, time)
        return Smooth(samples, rate, np.full_like(rate, noise), np.full_like(rate, noise / step))
    grid = np.linspace(time[0], time[-1], max(round((time[-1] - time[0]) / step) + 1, SHORTEST))
    if len(grid) == len(time) and np.allclose(grid, time, rtol=0, atol=0.01 * step):
        return _smooth_even(samples, noise, step)
    even = _smooth_even(np.interp(grid, time, samples), noise, float(grid[1] - grid[0]))
    return Smooth(*(np.interp(time, grid, getattr(even, field.name)) for field in dataclasses.fields(even)))


def _smooth_even(samples: Samples, noise: float, step: float) -> Smooth:
    best: list[np.ndarray] = []
    low, high = np.full(len(samples), -np.inf), np.full(len(samples), np.inf)
    agrees = np.ones(len(samples), dtype=bool)
    for window in _window_samples(step, len(samples)):
        value = scipy.signal.savgol_filter(samples, window, ORDER)
        rate = scipy.signal.savgol_filter(samples, window, ORDER, deriv=1, delta=step)
        error = noise * np.linalg.norm(scipy.signal.savgol_coeffs(window, ORDER))
        rate_error = noise * np.linalg.norm(scipy.signal.savgol_coeffs(window, ORDER, deriv=1, delta=step))
        low, high = np.maximum(low, value - CONFIDENCE * error), np.minimum(high, value + CONFIDENCE * error)
        agrees &= low <= high
        now = [value, rate, np.full_like(value, error), np.full_like(value, rate_error)]
        best = [np.where(agrees, new, old) for new, old in zip(now, best or now, strict=True)]
    return Smooth(*best)


def _window_samples(step: float, length: int) -> list[int]:
    """Odd numbers of samples, increasing, none longer than the trace."""
    wanted = {max(SHORTEST, round(seconds / step) // 2 * 2 + 1) for seconds in WINDOWS}
    return sorted(window for window in wanted if window <= length) or [SHORTEST]


@dataclasses.dataclass(frozen=True)
class Offset:
    """Constant error of a sensor over one trace, sensor minus truth, in its unit; an unknown one is 0 +- infinity."""

    value: float
    std_error: float

    @property
    def known(self) -> bool:
        """Whether the trace determines it."""
        return bool(np.isfinite(self.std_error))


UNKNOWN = Offset(0.0, np.inf)


def gas_pressure(trace: Trace) -> float:
    """The largest turbine pressure in Pa gauge, zero where none was recorded."""
    return 0.0 if trace.p_trb is None else float(np.max(trace.p_trb))


def has_gas(trace: Trace) -> bool:
    """Whether exhaust gas does anything that a position sensor could see."""
    return gas_pressure(trace) > limits.NO_GAS


def resting(model: AbstractModel, trace: Trace) -> Bool[np.ndarray, " time"]:
    """The samples before anything moves: duty and pressure at zero, atmosphere open.

    A ramp rests too until its duty closes the plunger; half of what that takes by the model is left as margin. A model
    without a converter is judged by the printed one.
    """
    still = np.zeros(len(trace.time), dtype=bool)
    if trace.pwm is None or trace.p_act is None or not bool(trace.start().at_rest):
        return still
    ambient = np.full_like(trace.time, trace.atmosphere)
    own = converter_of(model)
    converter = Converter() if own is None else own
    pull = converter.magnetic_force.steady_pull(trace.pwm, np.zeros_like(ambient))
    opening = np.asarray(converter.static_force(pull, ambient, reservoir_pressure(trace), ambient))
    return np.logical_and.accumulate((trace.pwm == 0.0) | (opening > np.maximum(0.5 * opening[0], 0.0)))


def sensor_offset(model: AbstractRodModel, trace: Trace, channel: str) -> Offset:
    """Offset of the sensor of `x_d` (m) or `p_act` (Pa) from the rest at the start of a trace.

    At rest the chamber is at atmosphere and the diaphragm where preload and open stop balance.
    """
    samples = getattr(trace, channel)
    if samples is None:
        return UNKNOWN
    rest = samples[resting(model, trace)]
    if len(rest) < limits.REST_SAMPLES:
        return UNKNOWN
    truth = float(model.diaphragm.rest_position(np.asarray(0.0))) if channel == "x_d" else trace.atmosphere
    error = noise_level(samples, channel) / np.sqrt(len(rest))
    if abs(drift_of(rest)) > limits.REST_DRIFT * 2 * error:
        return UNKNOWN
    return Offset(float(np.mean(rest)) - truth, error)


def reservoir_pressure(trace: Trace) -> Samples:
    """Reservoir pressure in Pa absolute, measured or assumed, as the models use it."""
    reservoir = trace.drive().reservoir
    assert reservoir is not None
    return np.asarray(reservoir.start)


def holds(trace: Trace, shortest: float) -> list[slice]:
    """Stretches of at least `shortest` seconds at one duty."""
    if trace.pwm is None:
        return []
    trace = trace.with_held_duty()
    edges = [0, *trace.jumps(), len(trace.time)]
    return [
        slice(begin, end)
        for begin, end in itertools.pairwise(edges)
        if trace.time[end - 1] - trace.time[begin] >= shortest
    ]


def duty_steps(trace: Trace) -> Int[np.ndarray, " steps"]:
    """Samples at which the duty steps."""
    if trace.pwm is None:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(np.abs(np.diff(trace.pwm)) > limits.DUTY_STEP) + 1


def slow_blocks(trace: Trace, length: float, fastest: float, roughness: float) -> list[slice]:
    """Consecutive stretches of `length` seconds over which the duty moves steadily.

    **Arguments:** `fastest` in %/s; `roughness`: how far in % the duty may stray from a straight line.
    """
    if trace.pwm is None:
        return []
    edges = np.searchsorted(trace.time, np.arange(trace.time[0], trace.time[-1], length))
    blocks = []
    for begin, end in itertools.pairwise(edges):
        duty, time = trace.pwm[begin:end], trace.time[begin:end]
        if end - begin < SHORTEST or duty[0] == duty[-1]:
            continue
        line = np.polyfit(time - time[0], duty, 1)
        if abs(line[0]) <= fastest and np.max(np.abs(duty - np.polyval(line, time - time[0]))) <= roughness:
            blocks.append(slice(int(begin), int(end)))
    return blocks
