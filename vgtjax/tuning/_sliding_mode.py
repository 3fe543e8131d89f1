"""Whether a switching observer slides in its closed loops [5.16]."""

import dataclasses

import numpy as np

from ..control import AbstractController, PressureObserver, designs_in
from ._cases import Cases
from ._problem import CaseCosts

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


def sliding(controller: AbstractController, *judged: tuple[Cases, CaseCosts], settled: float) -> Sliding | None:
    """Whether the controller's observer slides in closed loops that it ran in.

    The start of a run is left out: no observer slides while it is still finding the pressure. `None` for a controller
    without a switching observer, or where no closed loop was good.

    **Arguments:** closed loops, and what they were worth with the controller; `settled` in s, that of the objective.
    """
    switching = [
        (f"{prefix}switching_gain", design)
        for prefix, design in designs_in(controller)
        if isinstance(design, PressureObserver) and design.switching_gain > 0
    ]
    shares = np.concatenate([costs.sliding for _, costs in judged])
    if not switching or np.all(np.isnan(shares)):
        return None
    labels = [str(label) for cases, _ in judged for label in cases.labels]
    error = float(np.nanmax(np.concatenate([costs.pressure_peak for _, costs in judged])))
    (name, observer), place = switching[0], int(np.nanargmin(shares))
    return Sliding(
        name=name,
        gain=float(observer.switching_gain),
        share=float(shares[place]),
        case=labels[place],
        settled=settled,
        pressure_error=error,
        worth=float(observer.least_switching_gain(error)),
    )
