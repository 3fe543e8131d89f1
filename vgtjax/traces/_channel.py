"""One signal of a bench run, sampled at times of its own, and how noisy its sensor is."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._robust import deviation_by_differences
from ._signals import SIGNALS

Samples = Float[np.ndarray, " samples"]

FLOOR = {"x_d": 1e-7, "p_act": 1.0, "f_vane": 1e-4}
"""m, Pa and N; no sensor of such a bench is better, and a noise-free record must not get an infinite weight."""
GAP = 5.0
"""A step over this many median steps is a gap."""


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Channel:
    """A signal at times of its own: `time` in s and `value` in `unit`, both `(samples,)`.

    **Arguments:**

    - `valid`: which samples count, all by default. The others may hold anything and are dropped here, so that nothing
      downstream can use one by mistake.
    - `unit`: the SI unit of its signal, which the trace fills in.
    - `span`: from when to when in s the channel was recorded, by default from its first to its last sample, valid or
      not. Samples outside serve interpolation only.

    **Raises:** `InputError` when lengths differ, time does not increase strictly, a valid sample is not finite, or
    none is valid.
    """

    time: Samples
    value: Samples
    unit: str | None
    span: tuple[float, float]

    def __init__(
        self,
        time: ArrayLike,
        value: ArrayLike,
        valid: ArrayLike | None = None,
        *,
        unit: str | None = None,
        span: tuple[float, float] | None = None,
    ):
        times, values = (np.asarray(given, dtype=np.float64) for given in (time, value))
        counts = np.ones(times.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
        if times.ndim != 1 or not times.shape == values.shape == counts.shape:
            flags = "" if valid is None else f" and {counts.shape} of valid"
            raise InputError(
                f"a signal must have one value per time, but value has shape {values.shape} against {times.shape} of "
                f"time{flags}; give arrays of equal length"
            )
        _require_increasing(times)
        if not np.any(counts):
            raise InputError(
                f"a signal must have at least one valid sample, but none of its {len(times)} is; leave it out"
            )
        wrong = counts & ~np.isfinite(values)
        if np.any(wrong):
            at = int(np.argmax(wrong))
            raise InputError(
                f"every valid sample must be a finite number, but the one at {times[at]:g} s is {values[at]}; mark it "
                "invalid or remove it"
            )
        kept = slice(None) if np.all(counts) else counts
        vars(self).update(
            time=times[kept],
            value=values[kept],
            unit=unit,
            span=(float(times[0]), float(times[-1])) if span is None else span,
        )

    def cut(self, begin: float, end: float) -> "Channel":
        """The part between two times in s, with one sample beyond where a side falls between two, to interpolate to."""
        low = max(int(np.searchsorted(self.time, begin, side="right")) - 1, 0)
        high = int(np.searchsorted(self.time, end)) + 1
        span = max(self.span[0], begin), min(self.span[1], end)
        return dataclasses.replace(self, time=self.time[low:high], value=self.value[low:high], span=span)

    def within(self, begin: float, end: float) -> "Channel | None":
        """The samples between two times in s, both included; `None` without any."""
        inside = (self.time >= begin) & (self.time <= end)
        if np.all(inside):
            return self
        return dataclasses.replace(self, time=self.time[inside], value=self.value[inside]) if np.any(inside) else None

    def hold(self, time: Samples) -> Samples:
        """Values at other times, each that of the last sample; before the first one, that of the first."""
        return self.value[np.maximum(np.searchsorted(self.time, time, side="right") - 1, 0)]

    def interpolate(self, time: Samples) -> Samples:
        """Values at other times, linear between samples; beyond the ends, that of the nearest."""
        return np.interp(time, self.time, self.value)


def as_channel(trace: str, name: str, values: "Channel | ArrayLike", time: ArrayLike | None) -> Channel:
    """A given signal as a channel in its SI unit; an array is sampled at `time`.

    **Raises:** `InputError` as [`Channel`][] does, naming trace and signal; for another unit, and for no times.
    """
    unit = SIGNALS[name].unit
    try:
        if isinstance(values, Channel):
            if values.unit not in (None, unit):
                raise InputError(f"the signal must be in {unit}, but it is in {values.unit}; convert it")
            return dataclasses.replace(values, unit=unit)
        if time is None:
            raise InputError("an array needs the times of its samples, but none are given; give time, or a Channel")
        return Channel(np.asarray(time), np.asarray(values), unit=unit)
    except InputError as error:
        raise InputError(f"{trace}: {name}: {error}", "traces") from None


def gaps_of(time: Samples) -> Int[np.ndarray, " gaps"]:
    """Samples before which times have a gap."""
    steps = np.diff(time)
    return 1 + np.flatnonzero(steps > GAP * np.median(steps) * (1 + 1e-6)) if len(steps) else np.zeros(0, int)


def _require_increasing(time: Samples) -> None:
    broken = ~np.isfinite(time)
    broken[1:] |= ~(np.diff(time) > 0)
    if np.any(broken):
        at = int(np.argmax(broken))
        before = f" after {time[at - 1]:.9g} s" if at else ""
        raise InputError(
            f"time must be finite and increase strictly, but sample {at} is at {time[at]:.9g} s{before}; sort the "
            "samples and remove repeated ones"
        )


def noise_level(samples: Float[np.ndarray, " time"], channel: str) -> float:
    """Standard deviation of the white noise on a slowly moving signal, in its unit: the robust scale of third
    differences, no less than the quantisation of the record, `step / sqrt(12)`, or `FLOOR`.

    Of three and two samples that of lower differences, which has their motion in it; of one sample, which an offset
    explains, nothing is known.
    """
    order = min(3, len(samples) - 1)
    if order == 0:
        return FLOOR[channel]
    scale = deviation_by_differences(samples, order)
    steps = np.abs(np.diff(samples))
    steps = steps[steps > 1e-9 * np.max(np.abs(samples))]
    quantum = float(np.min(steps)) if len(steps) else 0.0
    return max(scale, quantum / np.sqrt(12.0), FLOOR[channel])
