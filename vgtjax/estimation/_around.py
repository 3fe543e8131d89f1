"""The misfit around the end of a fit: slices along all directions, and profiles of what they flag."""

import collections
import dataclasses
from typing import Literal

import numpy as np

from ._calibration import Calibration
from ._calibrator import Calibrator
from ._evaluation import Steps
from ._least_squares import NORMAL_95
from ._profiles import Profiles, profiling
from ._programs import run_alone
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


def look_around(calibrator: Calibrator, profiles: Literal["flagged", "all", "none"] = "flagged") -> Around:
    """Slices at the end of a calibration, and profiles of the parameters whose errors they cast doubt on, of all, or of
    none.

    **Arguments:** `calibrator`: at its end, as `run_alone(start_fit(task).ending())` leaves it.
    """
    return run_alone(looking_around(calibrator, profiles))


def looking_around(calibrator: Calibrator, profiles: Literal["flagged", "all", "none"]) -> Steps[Around]:
    """`look_around` as a computation."""
    end = End.of(calibrator)
    slices = yield from slicing(end)
    flagged = [] if profiles == "none" else slices.flagged()
    if profiles == "all":
        everything = [*flagged, *(entry for entry in end.entries if entry not in flagged)]
        return Around(slices, (yield from profiling(end, everything, len(everything))))
    return Around(slices, (yield from profiling(end, flagged)))
