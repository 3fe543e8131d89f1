"""Position and pressure of a trace without the noise of their sensors, worked out once for all tests that ask."""

import functools
import weakref
import zlib

import numpy as np

from ...traces import Trace, noise_level, remove_noise
from .._filters import Samples


class CleanSignals:
    """What is left of a measured position and pressure without the white noise of their sensors; offsets stay in.

    Both are evenly sampled at the same times. `noise` and `pressure_noise` are standard deviations of one sample in m
    and Pa, zero of what was not measured.
    """

    def __init__(self, position: Samples | None, pressure: Samples | None):
        self._position, self._pressure = position, pressure
        self.noise = 0.0 if position is None else noise_level(position, "x_d")
        self.pressure_noise = 0.0 if pressure is None else noise_level(pressure, "p_act")
        self._again: dict[int, Samples] = {}

    @functools.cached_property
    def position(self) -> Samples:
        """In m, of shape `(time,)`."""
        assert self._position is not None
        return remove_noise(self._position, self.noise)

    @functools.cached_property
    def pressure(self) -> Samples:
        """In Pa absolute, of shape `(time,)`."""
        assert self._pressure is not None
        return remove_noise(self._pressure, self.pressure_noise)

    def pressure_again(self, experiment: int) -> Samples:
        """As another measurement of the same pressure would have it, in Pa absolute and of shape `(time,)`; the noise
        of an experiment is the same whenever it is asked for."""
        if experiment not in self._again:
            random = np.random.default_rng([experiment, zlib.crc32(self.pressure.tobytes())])
            noise = random.normal(0, self.pressure_noise, len(self.pressure))
            self._again[experiment] = remove_noise(self.pressure + noise, self.pressure_noise)
        return self._again[experiment]


_KNOWN: weakref.WeakKeyDictionary[Trace, CleanSignals] = weakref.WeakKeyDictionary()
"""By trace, for as long as anybody has that; the signals don't hold it."""


def clean_signals(trace: Trace) -> CleanSignals:
    """Signals at the times of [`even`][], the same ones whenever a test reads the trace: to remove noise takes longer
    than most of what is done then."""
    if trace not in _KNOWN:
        sampled = even(trace)
        _KNOWN[trace] = CleanSignals(sampled.x_d, sampled.p_act)
    return _KNOWN[trace]


def even(trace: Trace) -> Trace:
    """The trace on one clock with evenly spaced times, which kernels need."""
    trace = trace.on_one_clock()
    steps = np.diff(trace.time)
    step = float(np.median(steps))
    if np.all(np.abs(steps - step) < 0.01 * step):
        return trace
    return trace.on_one_clock(trace.time[0] + step * np.arange(int((trace.time[-1] - trace.time[0]) / step) + 1))
