"""The misfit around the end of a fit: slices along all directions, and profiles of what they flag."""

import collections
import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool

from .._calibration import Calibration
from .._calibrator import Calibrator
from .._estimate import Estimate
from .._least_squares import FACTOR, NORMAL_95
from ..derivatives import Computation, run_alone
from ._profiles import Profiles, profiling
from ._slices import WORDS, End, Slices, slicing

ConfidenceInterval = tuple[float | None, float | None]
"""Ends in the units of the table; `None` for one that is open."""


@dataclasses.dataclass(frozen=True, eq=False)
class Around:
    """The misfit around the end of a fit."""

    slices: Slices
    profiles: Profiles

    words = WORDS

    @property
    def sentences(self) -> list[str]:
        """What is worth a word in the terminal."""
        found = []
        if bent := self.slices.no_parabolas:
            counts = collections.Counter(each.verdict for each in bent)
            named = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
            found.append(
                f"the misfit is no parabola along {len(bent)} of {len(self.slices.slices)} directions ({named}); the "
                f"least determined of these is carried by {', '.join(bent[0].carried_by)}"
            )
        found += [f"profile of {name}: {profile.verdict}" for name, profile in self.profiles.profiles.items()]
        if self.profiles.left_out:
            found.append(f"{len(self.profiles.left_out)} more carry such directions, and have no profile")
        return found

    def intervals(self, calibration: Calibration) -> dict[str, ConfidenceInterval | None]:
        """95 % intervals of what has a profile, in the units of the table: open ends are `None`, or zero below a
        positive value; `None` for one that is open on both sides, and for what carries a direction along which the fit
        did not end at its minimum."""
        found: dict[str, ConfidenceInterval | None] = {}
        entries, transform = calibration.task.selection.entries, calibration.transform
        for number, name in enumerate(entries):
            if name in self.profiles.profiles:
                at = calibration.progress.coordinates[number]
                linear = NORMAL_95 * float(calibration.uncertainty.std_errors[number])
                ends = at + np.array(self.profiles.profiles[name].widened(linear))
                positive, scale = transform.positive[number], transform.scale[number]
                with np.errstate(over="ignore"):
                    low, high = (np.exp(ends) if positive else scale * ends).tolist()
                bounded = [end if np.isfinite(end) else None for end in (low, high)]
                nothing = bounded[1] is None and (bounded[0] is None or (positive and low == 0.0))
                found[name] = None if nothing else (bounded[0], bounded[1])
        lower = [each for each in self.slices.slices if each.verdict == "downhill"]
        return found | {name: None for each in lower for name in each.carried_by if name in entries}

    def determined(self, calibration: Calibration) -> Bool[np.ndarray, " parameters"]:
        """Which entries a fit has determined by their linear errors and by these intervals.

        An interval tells a positive value where it ends within a factor of ten to either side, and a value that may
        have either sign where it is not open on both sides.
        """
        found = calibration.determined.copy()
        intervals, entries = self.intervals(calibration), calibration.task.selection.entries
        for number, name in enumerate(entries):
            if name in intervals:
                positive = bool(calibration.transform.positive[number])
                value, interval = float(calibration.values[number]), intervals[name]
                found[number] &= _ends_within(value, interval) if positive else interval is not None
        return found

    def estimates(self, calibration: Calibration) -> dict[str, Estimate]:
        """What a fit found of every free entry, with these intervals in the place of the linear ones; an interval that
        is open on both sides, or tells nothing, is NaN."""
        intervals, determined = self.intervals(calibration), self.determined(calibration).tolist()
        found = {}
        for (entry, linear), known in zip(calibration.estimates.items(), determined, strict=True):
            ends = _as_numbers(intervals[entry]) if entry in intervals else linear.interval
            found[entry] = dataclasses.replace(linear, interval=ends, determined=known)
        return found


def _as_numbers(interval: ConfidenceInterval | None) -> tuple[float, float]:
    if interval is None:
        return np.nan, np.nan
    low, high = interval
    return -np.inf if low is None else low, np.inf if high is None else high


def _ends_within(value: float, interval: ConfidenceInterval | None) -> bool:
    """Whether a 95 % interval of a positive value ends within `FACTOR` to either side."""
    low, high = interval or (None, None)
    return low is not None and high is not None and low * FACTOR >= value and high <= value * FACTOR


def look_around(calibrator: Calibrator, profiles: Literal["flagged", "all", "none"] = "flagged") -> Around:
    """Slices at the end of a calibration, and profiles of the parameters whose errors they cast doubt on and of those
    that are hardly determined, of all, or of none.

    **Arguments:** `calibrator`: at its end, as `run_alone(start_fit(task).ending())` leaves it.
    """
    return run_alone(looking_around(calibrator, profiles))


def looking_around(calibrator: Calibrator, profiles: Literal["flagged", "all", "none"]) -> Computation[Around]:
    """`look_around` as a computation."""
    end = End.of(calibrator)
    slices = yield from slicing(end)
    flagged = [] if profiles == "none" else _doubtful(end, slices)
    if profiles == "all":
        everything = [*flagged, *(entry for entry in end.entries if entry not in flagged)]
        return Around(slices, (yield from profiling(end, everything, len(everything))))
    return Around(slices, (yield from profiling(end, flagged)))


def _doubtful(end: End, slices: Slices) -> list[str]:
    """What needs a profile: first what hardly passes for determined, whose linear error depends on where a search has
    ended (a damping whose force is below the noise has the longer error the smaller it is), then what slices flag."""
    hardly = end.found.borderline(end.problem.transform.positive).tolist()
    named = [entry for entry, is_hardly in zip(end.entries, hardly, strict=True) if is_hardly]
    return list(dict.fromkeys([*named, *slices.flagged()]))
