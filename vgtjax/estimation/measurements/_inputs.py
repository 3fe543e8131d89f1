"""A measured pressure that drives a rod: read without the noise of its sensor, and without what that shows at rest.

White noise of 60 Pa is a force of 0.8 N that shakes the rod faster than bristles give way: read as it is, stiction all
but disappears from a fit, and the mass is half as large again. What reading leaves of noise and offset goes into every
error, by experiment: the same pressure with fresh noise, read again.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...plants import AbstractModel
from ...traces import MOVES, START_WINDOW, Trace, drift_of, noise_level, remove_noise
from ._evidence import Unknown

JITTER = 0.3
"""Part of the mean interval by which a sample may be off its place on an even clock; others are put on a finer one, of
which some samples are missing."""
FINEST = 0.25
"""Part of the median interval that even ones are made of at least."""
LEAST = 30
"""Samples of rest that tell an offset."""


@dataclasses.dataclass(frozen=True)
class InputSensor:
    """What is known of the sensor of a trace's driving pressure, in Pa: its `noise` and its `offset`, with the standard
    error of that; no error where nothing is subtracted."""

    noise: float
    offset: float = 0.0
    offset_error: float = 0.0

    def read(self, trace: Trace) -> Trace:
        """The trace with the pressure that its sensor was shown."""
        pressure = trace.channels["p_act"]
        places = _even_places(pressure.time)
        samples, seen = np.zeros(places[-1] + 1), np.zeros(places[-1] + 1, bool)
        samples[places], seen[places] = pressure.value, True
        clean = remove_noise(samples, self.noise, seen)[places]
        return trace.replace(p_act=dataclasses.replace(pressure, value=clean - self.offset))

    def again(self, trace: Trace, rng: np.random.Generator) -> Trace:
        """A trace that was read already, as another measurement of the same pressure would be read."""
        pressure = trace.channels["p_act"]
        more = rng.normal(0, self.noise, len(pressure.value)) + self.offset_error * rng.normal()
        shown = trace.replace(p_act=dataclasses.replace(pressure, value=pressure.value + more))
        return InputSensor(self.noise).read(shown)


def input_sensor(model: AbstractModel, trace: Trace, unknown: Unknown) -> InputSensor | None:
    """The sensor of the pressure that drives a rod; `None` where no pressure does, or it is read as it is recorded.

    An offset that is free is not read from rest, nor one where the pressure does not rest.
    """
    if not unknown.input_noise or "p_act" in model.sensed or trace.f_drive is not None:
        return None
    pressure = trace.channels.get("p_act")
    if pressure is None:
        return None
    noise = noise_level(pressure.value, "p_act")
    rest = pressure.value[_resting(trace)]
    if "p_act" in unknown.offset or len(rest) < LEAST or abs(drift_of(rest)) > MOVES:
        return InputSensor(noise)
    # Noise with a memory moves the mean by more than white noise does, and shows as a drift.
    error = max(noise / float(np.sqrt(len(rest))), 0.5 * abs(drift_of(rest)))
    return InputSensor(noise, float(np.mean(rest)) - trace.atmosphere, error)


def read_inputs(
    model: AbstractModel, traces: Sequence[Trace], unknown: Unknown
) -> tuple[list[Trace], list[InputSensor | None]]:
    """Traces as the pressure that drives them is read, and what is known of its sensors."""
    sensors = [input_sensor(model, trace, unknown) for trace in traces]
    read = [trace if sensor is None else sensor.read(trace) for trace, sensor in zip(traces, sensors, strict=True)]
    return read, sensors


def _even_places(time: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " samples"]:
    """Which of evenly spaced samples those of a clock are, of which some may be missing."""
    steps = np.diff(time)
    if len(steps) == 0:
        return np.arange(len(time))
    usual = (time - time[0]) / np.mean(steps)
    if len(np.unique(np.round(usual))) == len(time) and np.max(np.abs(usual - np.round(usual))) < JITTER:
        return np.round(usual).astype(int)
    return np.round((time - time[0]) / max(np.min(steps), FINEST * np.median(steps))).astype(int)


def _resting(trace: Trace) -> Bool[np.ndarray, " samples"]:
    """Samples of the pressure at the start of a trace at which the chamber is at atmosphere."""
    time, duty = trace.channels["p_act"].time, trace.at("pwm", trace.channels["p_act"].time)
    if not bool(trace.start().at_rest):
        return np.zeros(len(time), bool)
    if duty is None:
        return time <= time[0] + START_WINDOW
    return np.logical_and.accumulate(duty == 0.0)
