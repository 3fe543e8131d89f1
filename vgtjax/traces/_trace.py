"""A bench trace: signals over time, in SI units with absolute pressures."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float, Int, PyTree

from .._errors import InputError
from ._drive import Drive, Ramp, Start

STANDARD_ATMOSPHERE = 101013.0
"""Pa; what turns gauge into absolute pressure unless a trace states its own atmosphere."""
ASSUMED_RESERVOIR = 2.0e4
"""Pa absolute; assumed where no trace tells the reservoir pressure."""
SENSOR_PRESSURE_OFFSET = 5000.0
"""Pa; pressure sensors are trusted to within 50 mbar."""
START_WINDOW = 0.05
"""s; the start of a trace that does not begin at rest is the mean of its first 50 ms."""

Samples = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """Signals of one bench run, each of shape `(time,)` or `None` where the bench did not record it.

    `time` in s, `pwm` in percent (held from its sample to the next), `p_act` and `p_res` in Pa absolute, `p_trb`
    in Pa gauge, `x_d` in m, `f_vane` and `f_drive` in N, `x_drive` in m (a position that drives the pneumatic model,
    free of the sensor's offset and noise; no file has it), `atmosphere` in Pa. `notes` says what loading assumed or
    ignored.

    **Raises:** `InputError` when the signals differ in length or are not finite, or time does not increase.
    """

    time: Samples
    pwm: Samples | None = None
    p_act: Samples | None = None
    p_res: Samples | None = None
    p_trb: Samples | None = None
    x_d: Samples | None = None
    f_vane: Samples | None = None
    f_drive: Samples | None = None
    x_drive: Samples | None = None
    atmosphere: float = STANDARD_ATMOSPHERE
    name: str = "trace"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field in SIGNALS:
            value = getattr(self, field)
            if value is not None:
                value = np.asarray(value, dtype=np.float64)
                object.__setattr__(self, field, value)
                if value.shape != np.shape(self.time) or value.ndim != 1:
                    raise InputError(
                        f"{self.name}: every signal must have one value a time stamp, but {field} has shape "
                        f"{value.shape} against {np.shape(self.time)} of time; give arrays of equal length"
                    )
                if not np.all(np.isfinite(value)):
                    raise InputError(
                        f"{self.name}: every sample must be a finite number, but {field} has others; remove them"
                    )
        if len(self.time) < 2 or not np.all(np.diff(self.time) > 0):
            raise InputError(
                f"{self.name}: time must have at least two samples and increase strictly; sort the samples and "
                "remove repeated ones"
            )

    @property
    def longest_interval(self) -> float:
        """Longest time between two samples in s."""
        return float(np.max(np.diff(self.time)))

    def window(self, begin: float, end: float) -> "Trace":
        """The part between two times in s, both included; time keeps its zero.

        **Raises:** `InputError` when fewer than two samples are left.
        """
        inside = (self.time >= begin) & (self.time <= end)
        if np.count_nonzero(inside) < 2:
            raise InputError(
                f"{self.name}: the window [{begin:g}, {end:g}] s must keep at least two samples of a trace that "
                f"runs from {self.time[0]:g} to {self.time[-1]:g} s; widen it"
            )
        signals = {field: None if getattr(self, field) is None else getattr(self, field)[inside] for field in SIGNALS}
        return dataclasses.replace(self, **signals)

    def drive(self) -> Drive:
        """Inputs over the interval that each sample begins; the last one has no length."""
        duration = np.append(np.diff(self.time), 0.0)

        def ramp(values: Samples | None) -> Ramp | None:
            if values is None:
                return None
            rate = np.append(np.diff(values) / duration[:-1], 0.0)
            return Ramp(values, rate)

        none_known = np.zeros_like(self.time)
        reservoir = np.full_like(self.time, ASSUMED_RESERVOIR) if self.p_res is None else self.p_res
        turbine = none_known if self.p_trb is None else self.p_trb
        return Drive(
            duration=duration,
            ambient_shift=np.full_like(self.time, self.atmosphere - STANDARD_ATMOSPHERE),
            turbine=Ramp(turbine, np.zeros_like(self.time)) if self.p_trb is None else ramp(turbine),
            pwm=self.pwm,
            reservoir=ramp(reservoir),
            chamber=ramp(self.p_act),
            force=ramp(self.f_drive),
            position=ramp(self.x_drive),
        )

    def jumps(self) -> Int[np.ndarray, " jumps"]:
        """Samples at which the duty differs from the one before: there the vector field jumps."""
        return np.zeros(0, int) if self.pwm is None else np.flatnonzero(np.diff(self.pwm)) + 1

    def start(self) -> Start:
        """What the trace says about the state at its first sample."""
        first = self.time <= self.time[0] + START_WINDOW
        # What the first duty step has moved already says nothing about the rest before it.
        still = first if self.pwm is None else first & np.logical_and.accumulate(self.pwm == self.pwm[0])
        pressure = 0.0 if self.p_act is None else float(np.mean(self.p_act[first]))
        position = 0.0 if self.x_d is None else float(np.mean(self.x_d[first]))
        off = self.pwm is None or self.pwm[0] == 0.0
        before = self.atmosphere if self.p_act is None else float(np.mean(self.p_act[still]))
        vented = abs(before - self.atmosphere) <= SENSOR_PRESSURE_OFFSET
        driven = self.f_drive is not None
        return Start(
            at_rest=np.asarray(off and vented and not driven),
            pressure=np.asarray(pressure),
            pressure_known=np.asarray(self.p_act is not None),
            position=np.asarray(position),
            position_known=np.asarray(self.x_d is not None),
        )


SIGNALS = ("time", "pwm", "p_act", "p_res", "p_trb", "x_d", "f_vane", "f_drive", "x_drive")
"""Fields of [`Trace`][] that hold one value a sample."""


def require(trace: Trace, needs: tuple[str, ...]) -> None:
    """Checks that a trace has the columns that a model needs.

    **Raises:** `InputError` naming the missing column.
    """
    for need in needs:
        alternatives = need.split("|")
        if all(getattr(trace, column) is None for column in alternatives):
            raise InputError(
                f"{trace.name}: this model needs the column {' or '.join(alternatives)}, which is missing; "
                "record it or choose another model"
            )


def cast(tree: PyTree[np.ndarray], dtype: np.dtype) -> PyTree[np.ndarray]:
    """Floating leaves of a drive or start in the precision of a model; flags stay flags."""
    return jax.tree.map(lambda leaf: leaf if leaf.dtype == bool else leaf.astype(dtype), tree)
