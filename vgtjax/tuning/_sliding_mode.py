"""Whether a switching observer slides in its closed loops [5.16]."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..control import AbstractController, PressureObserver, designs_in
from ._cases import Cases
from ._loops import Figures

ENOUGH = 0.99
"""Share of samples at which an observer slides that counts as sliding: noise of the velocity throws it off at some."""


@dataclasses.dataclass(frozen=True)
class Sliding:
    """How far a switching observer slides where it does so least, and what the errors of its pressure are worth.

    `name` and `gain` in m/s2 are those of its `switching_gain`; `share` of the samples from `settled` s on is that of
    the closed loop `case`. `pressure_error` in Pa is the largest of all, and `worth` the gain in m/s2 that it asks for
    with a model that is right otherwise. What is wrong with the model asks for more, or for less where the pressure has
    taken it up; so the samples decide.
    """

    name: str
    gain: float
    share: float
    case: str
    settled: float
    pressure_error: float
    worth: float

    @property
    def slides(self) -> bool:
        """Whether the gain is large enough."""
        return self.share >= ENOUGH

    @property
    def sentence(self) -> str:
        """What was seen; and what to do where the observer does not slide."""
        seen = (
            f"{self.name} is {self.gain:.3g} m/s2, and holds the velocity at {100 * self.share:.3g} % of the samples "
            f"from {self.settled:g} s on in '{self.case}'"
        )
        if self.slides:
            return f"the observer slides: {seen} at least"
        return (
            f"the observer does not slide: {seen}; the largest error of its pressure, {self.pressure_error:.4g} Pa, is "
            f"worth {self.worth:.3g} m/s2 [5.16]; start well above that and state the error in largest_pressure_error, "
            "which bounds the gain, or fix it at 0, which is the smooth observer"
        )


class _Seen(NamedTuple):
    """How far an observer slides in one closed loop, the largest error of its pressure in Pa, and the name of its
    gain."""

    share: float
    error: float
    case: str
    name: str
    observer: PressureObserver


def sliding(
    controllers: AbstractController | Mapping[str, AbstractController],
    *judged: tuple[Cases, Figures],
    settled: float,
) -> Sliding | None:
    """Whether an observer slides in closed loops that it ran in.

    The start of a run is left out: no observer slides while it is still finding the pressure. `None` for controllers
    without a switching observer, or where no closed loop was good.

    **Arguments:** one controller, or one for each plant by its name; closed loops, and what was seen of them with it;
    `settled` in s, from which on it was seen.
    """
    rows = []
    for cases, seen in judged:
        for label, share, error in zip(cases.labels, seen.sliding, seen.pressure_peak, strict=True):
            found = _switching(controllers[label.plant] if isinstance(controllers, Mapping) else controllers)
            if found is not None and not np.isnan(share):
                rows.append(_Seen(float(share), float(error), str(label), *found))
    if not rows:
        return None
    least, wrong = min(rows, key=lambda seen: seen.share), max(rows, key=lambda seen: seen.error)
    return Sliding(
        name=least.name,
        gain=float(least.observer.switching_gain),
        share=least.share,
        case=least.case,
        settled=settled,
        pressure_error=wrong.error,
        worth=float(wrong.observer.least_switching_gain(wrong.error)),
    )


def _switching(controller: AbstractController) -> tuple[str, PressureObserver] | None:
    """The observer of a controller that switches, and the name of its gain."""
    for prefix, design in designs_in(controller):
        if isinstance(design, PressureObserver) and design.switching_gain > 0:
            return f"{prefix}switching_gain", design
    return None
