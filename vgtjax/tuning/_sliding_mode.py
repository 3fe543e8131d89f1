"""Whether a switching observer slides for the errors that its closed loops showed [5.16]."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..control import AbstractController, PressureObserver, designs_in
from ._cases import Cases
from ._problem import CaseCosts


@dataclasses.dataclass(frozen=True)
class Sliding:
    """What an observer's `switching_gain` has to exceed, and what it is, in m/s2.

    `pressure_error` in Pa is the largest that was seen, in the closed loop `case`, and `settled` the time in s from
    which on it was looked for. `name` is that of the gain.
    """

    name: str
    gain: float
    needed: float
    pressure_error: float
    case: str
    settled: float

    @property
    def slides(self) -> bool:
        """Whether the gain is large enough."""
        return self.gain > self.needed

    @property
    def sentence(self) -> str:
        """Both gains, and where the error was; what to do where the observer does not slide."""
        bound = (
            f"{self.needed:.3g} m/s2 that sliding needs at the largest error of the observed pressure, "
            f"{self.pressure_error:.4g} Pa from {self.settled:g} s on in '{self.case}' [5.16]"
        )
        if self.slides:
            return f"the observer slides: {self.name} is {self.gain:.3g} m/s2, above the {bound}"
        return (
            f"the observer does not slide: {self.name} is {self.gain:.3g} m/s2, below the {bound}; fix it at 0, which "
            "is the smooth observer, or state an error in largest_pressure_error, which bounds it"
        )


def sliding(controller: AbstractController, *judged: tuple[Cases, CaseCosts], settled: float) -> Sliding | None:
    """Whether the controller's observer slides at the largest error of its pressure in closed loops that it ran in.

    The start of a run is left out: no observer slides while it is still finding the pressure. `None` for a controller
    without a switching observer, or where no closed loop was good.

    **Arguments:** closed loops, and what they were worth with the controller; `settled` in s, that of the objective.
    """
    switching = [
        (f"{prefix}switching_gain", design)
        for prefix, design in designs_in(controller)
        if isinstance(design, PressureObserver) and design.switching_gain > 0
    ]
    errors = np.concatenate([costs.pressure_peak for _, costs in judged])
    if not switching or np.all(np.isnan(errors)):
        return None
    labels: Sequence[str] = [str(label) for cases, _ in judged for label in cases.labels]
    (name, observer), place = switching[0], int(np.nanargmax(errors))
    needed = float(observer.least_switching_gain(errors[place]))
    return Sliding(name, float(observer.switching_gain), needed, float(errors[place]), labels[place], settled)
