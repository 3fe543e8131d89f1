"""A trace whose turbine pressure pulsates, as a slow sensor does not show."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .._errors import InputError, require_positive
from ..traces import Channel, Trace
from ._cycle import pulsation
from ._engine import Engine
from ._operating_point import OperatingPoint
from ._valve import CYCLE

SAMPLES = 40
"""Least number of samples in a firing interval, between which the pressure is linear."""

Times = Float[np.ndarray, " _"]


@dataclasses.dataclass(frozen=True, eq=False)
class PressurePulsation:
    """What an engine's firing lays over a turbine pressure whose mean is known.

    **Arguments:**

    - `pressure`: over one cycle of the engine, evenly sampled, in Pa absolute.
    - `engine_speed`: in rpm.
    - `cylinders`: how often the engine fires in a cycle.
    - `share`: half of the pulsation from peak to peak, as a part of the mean gauge pressure; `None` is as large a part
      as in `pressure`.

    **Raises:** `InputError` for a speed that is not positive, or a share not between zero and one.
    """

    pressure: Float[np.ndarray, " crank"]
    engine_speed: float
    cylinders: int
    share: float | None = None

    def __post_init__(self) -> None:
        require_positive("engine_speed", self.engine_speed, "speed in rpm", "correct it")
        if self.share is not None and not 0 < self.share < 1:
            raise InputError(
                f"the share of a pulsation must lie between 0 and 1, but it is {self.share:g}; choose e.g. 0.2"
            )

    @classmethod
    def of(cls, engine: Engine, point: OperatingPoint, share: float | None = None) -> "PressurePulsation":
        """That of an engine at a point.

        **Raises:** as [`pulsation`][].
        """
        pressure = np.asarray(pulsation(engine, point).p_trb)
        return cls(pressure, float(point.engine_speed), engine.cylinders, share)

    @property
    def firing_interval(self) -> float:
        """s from one firing to the next."""
        return CYCLE / self.cylinders / (6 * self.engine_speed)

    def shape(self, atmosphere: float) -> Float[np.ndarray, " crank"]:
        """Deviation from the mean over a cycle, as a part of the mean gauge pressure; its mean is zero.

        **Raises:** `InputError` when the engine's mean pressure is not above `atmosphere` in Pa.
        """
        mean = float(np.mean(self.pressure))
        deviation = self.pressure - mean
        if self.share is not None:
            return self.share * deviation / (0.5 * np.ptp(deviation))
        if not mean > atmosphere:
            raise InputError(
                f"the engine's mean turbine pressure must be above the atmosphere of {atmosphere:g} Pa, but it is "
                f"{mean:.0f} Pa; raise its outlet_pressure, or give a share for the amplitude"
            )
        return deviation / (mean - atmosphere)

    def applied(self, trace: Trace) -> Trace:
        """The trace with a turbine pressure that pulsates in proportion to its gauge pressure, about what it was.

        The channel gets a clock of its own that divides the times of the trace; without a turbine pressure above the
        atmosphere the trace stays what it is.
        """
        slow = trace.channels.get("p_trb")
        if slow is None or not np.any(slow.value):
            return trace
        times = trace.time[(trace.time >= slow.time[0]) & (trace.time <= slow.time[-1])]
        times = _divided(times, self.firing_interval / SAMPLES)
        shape = self.shape(trace.atmosphere)
        angles = CYCLE / len(shape) * np.arange(len(shape))
        part = np.interp(6 * self.engine_speed * times, angles, shape, period=CYCLE)
        return trace.replace(p_trb=Channel(times, slow.interpolate(times) * (1 + part), span=slow.span))


def _divided(times: Times, longest: float) -> Times:
    """Increasing times with more between them, evenly, so that none is more than `longest` s after the one before."""
    gaps = np.diff(times)
    parts = np.maximum(np.ceil(gaps / longest), 1).astype(int)
    first = np.cumsum(parts) - parts
    number = np.arange(np.sum(parts)) - np.repeat(first, parts)
    return np.append(np.repeat(times[:-1], parts) + number * np.repeat(gaps / parts, parts), times[-1])
