"""What the samples of a file must fulfil: clocks that run, numbers that are numbers, and lie where sensors can."""

import math

import numpy as np

from ._assignment import Assigned
from ._channel import Samples, gaps_of
from ._trace import SENSOR_PRESSURE_OFFSET
from .files import Entry, Recording

Numbers = np.ndarray

TRAVEL = 10.13e-3
"""m; the printed `diaphragm.travel`, for a caller who knows no better."""
SENSOR_POSITION_OFFSET = 0.5e-3
"""m; position sensors are trusted to within half a millimetre."""
HIGHEST_BOOST = 2e6
"""Pa gauge; no turbine inlet sees 20 bar."""
SHORTEST, LONGEST = 1e-6, 0.5
"""s; no bench samples faster or more slowly, but time in another unit than it says seems to: milliseconds of a record
at 1 kHz, taken for seconds, are one sample per second."""


def check_numbers(recording: Recording, entry: Entry, values: Numbers, kinds: str = "fiub") -> None:
    """Refuses what is not one number per sample, and NaN or infinity.

    **Arguments:** `kinds`: of the numbers, as NumPy names them.

    **Raises:** `InputError`.
    """
    if values.ndim != 1 or values.dtype.kind not in kinds:
        what = "text" if values.dtype.kind in "SUO" else f"an array of {values.dtype} with shape {values.shape}"
        raise recording.fail(
            f"a {recording.noun} must have one number per {recording.item}, but it has {what}", "choose another", entry
        )


def check_finite(
    recording: Recording, entry: Entry, values: Numbers, valid: Numbers, rows: Numbers | None = None
) -> None:
    """Refuses NaN and infinity where a sample is valid; `rows`: where samples are in the file, if not one by one.

    **Raises:** `InputError`.
    """
    wrong = valid & ~np.isfinite(values)
    if np.any(wrong):
        at = int(np.argmax(wrong))
        raise recording.fail(
            f"'{values[at]}' is not a finite number",
            f"remove the {recording.item} or repair it",
            entry,
            at if rows is None else int(rows[at]),
        )


def check_increasing(recording: Recording, entry: Entry, time: Samples) -> None:
    """Refuses time that stands still or runs back; `time` in the unit of the file.

    **Raises:** `InputError`.
    """
    item = recording.item
    if len(time) < 2:
        what = f"a trace needs at least two samples, but it has {len(time)}"
        raise recording.fail(what, "export the trace again", entry)
    steps = np.diff(time)
    if np.any(steps <= 0):
        at = int(np.argmax(steps <= 0)) + 1
        what = "stands still" if steps[at - 1] == 0 else "runs back"
        raise recording.fail(
            f"time must increase from {item} to {item}, but it {what} ({time[at - 1]:.9g} to {time[at]:.9g})",
            f"remove the repeated or misplaced {item}s",
            entry,
            at,
        )


def check_gaps(recording: Recording, entry: Entry, time: Samples, rows: Numbers) -> None:
    """Refuses a step over five times the median.

    **Arguments:** `time` in the unit of the file; `rows`: where its samples are in the file.

    **Raises:** `InputError`.
    """
    steps, gaps = np.diff(time), gaps_of(time)
    if len(gaps):
        at = int(gaps[0])
        raise recording.fail(
            f"time has a gap of {steps[at - 1]:g} where the median step is {np.median(steps):g}",
            "split the trace there, or record it without loss",
            entry,
            int(rows[at]),
        )


def check_rate(recording: Recording, entry: Entry, time: Samples) -> None:
    """Refuses times in s that can't be: picoseconds, say, that pretend to be seconds.

    **Raises:** `InputError`.
    """
    if len(time) < 2:
        return
    step = float(np.median(np.diff(time)))
    if not SHORTEST * (1 - 1e-6) <= step <= LONGEST * (1 + 1e-6):
        raise recording.fail(
            f"the median step of a trace must be {SHORTEST:g} to {LONGEST:g} s, but here it is {step:g} s",
            "check the unit of time",
            entry,
        )


def check_range(
    recording: Recording,
    assigned: Assigned,
    raw: Samples,
    values: Samples,
    rows: Numbers,
    ends: tuple[float, float],
) -> None:
    """Refuses values outside of `ends`, which [`ends_of`][] knows.

    **Arguments:** `raw` in the unit of the file and `values` in SI; `rows`: where the samples are in the file.

    **Raises:** `InputError`.
    """
    low, high = ends
    rounding = 1e-9 * max(abs(end) for end in ends if math.isfinite(end))
    outside = (values < low - rounding) | (values > high + rounding)
    if np.any(outside):
        at = int(np.argmax(outside))
        si = {"pwm": "%", "x_d": "m", "p_trb": "Pa gauge"}.get(assigned.signal, "Pa absolute")
        raise recording.fail(
            f"{raw[at]:g} [{assigned.unit}] is outside what sensor and physics allow ({low:g} to {high:g} {si})",
            "check the sensor, its unit, and gauge against absolute",
            assigned.entry,
            int(rows[at]),
        )


def ends_of(atmosphere: float, travel: float) -> dict[str, tuple[float, float]]:
    """What sensor and physics allow, in SI by signal; sensors have offsets."""
    between = (-SENSOR_PRESSURE_OFFSET, atmosphere + SENSOR_PRESSURE_OFFSET)
    return {
        "pwm": (0.0, 100.0),
        "p_act": between,
        "p_res": between,
        "p_trb": (-atmosphere - SENSOR_PRESSURE_OFFSET, HIGHEST_BOOST),
        "x_d": (-SENSOR_POSITION_OFFSET, travel + SENSOR_POSITION_OFFSET),
    }
