"""What a fit says of the misfit around its end: slices along all directions, and profiles of what they flag."""

import collections
import dataclasses
import itertools
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import (
    NORMAL_95,
    WORDS,
    Calibration,
    Calibrator,
    End,
    Profiles,
    Slices,
    Steps,
    profiling,
    slicing,
)

from ..output import figures
from ..output.files import finite
from ..study.parameter_file import Interval

LEAST_LOADING = 0.1
"""Loadings below this are left out of `summary.json`, but for the largest: a hundredth of a variance."""


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

    def summary(self) -> dict[str, Any]:
        """Slices and profiles with their values at `reaches` in standard errors, `None` where a simulation failed."""
        slices = [
            {
                "direction": each.direction,
                "loadings": {
                    name: value
                    for name, value in each.loadings.items()
                    if abs(value) >= LEAST_LOADING or name in each.carried_by
                },
                "reaches": list(each.reaches),
                "values": finite(each.values),
                "shift": each.shift,
                "verdict": each.verdict,
            }
            for each in self.slices.slices
        ]
        profiles = {
            name: {
                "reaches": list(each.reaches),
                "values": finite(each.values),
                "ends": finite(each.ends),
                "verdict": each.verdict,
            }
            for name, each in self.profiles.profiles.items()
        }
        counts = {"slices": self.slices.left_out, "profiles": self.profiles.left_out}
        evaluations = {"slices": self.slices.evaluations, "profiles": self.profiles.evaluations}
        return {"slices": slices, "profiles": profiles, "not_looked_at": counts, "evaluations": evaluations}

    def intervals(self, calibration: Calibration) -> dict[str, Interval | None]:
        """95 % intervals of what has a profile, in the units of the table: open ends are `None`, or zero below a
        positive value; `None` for one that is open on both sides, and for what carries a direction along which the fit
        did not end at its minimum."""
        found: dict[str, Interval | None] = {}
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


def looking_around(calibrator: Calibrator, profiles: Literal["flagged", "all", "none"]) -> Steps[Around]:
    """Slices at the end of a calibration, and profiles of the parameters that are asked for, as a computation."""
    end = End.of(calibrator)
    slices = yield from slicing(end)
    flagged = [] if profiles == "none" else slices.flagged()
    if profiles == "all":
        everything = [*flagged, *(entry for entry in end.entries if entry not in flagged)]
        return Around(slices, (yield from profiling(end, everything, len(everything))))
    return Around(slices, (yield from profiling(end, flagged)))


def slices_figure(slices: Slices) -> go.Figure:
    """All slices over each other; those that are no parabolas have their names."""
    figure = go.Figure()
    reach = np.linspace(-2.0, 2.0, 81)
    figure.add_trace(figures.curve(reach, reach**2, "parabola", figures.MEASURED, width=6, opacity=0.4))
    same = [each for each in slices.slices if each.is_parabola]
    pairs = [pair for each in same for pair in zip(each.reaches, each.values, strict=True)]
    x, y = np.reshape(pairs, (-1, 2)).T
    figure.add_trace(figures.points(x, y, "parabolas", figures.DUTY, 5, opacity=0.6))
    for each, color in zip(slices.no_parabolas, itertools.cycle(figures.PALETTE), strict=False):
        x, y = np.transpose(sorted([*zip(each.reaches, each.values, strict=True), (0.0, 0.0)]))
        shown = np.where(np.isfinite(y), y, np.nan)
        name = f"{each.direction}: {each.carried_by[0]}, {each.verdict}"
        figure.add_trace(figures.curve(x, shown, name, color, mode="lines+markers"))
    return figures.styled(figure, 380, "standard errors", "rise of chi^2", hovermode="closest")
