"""What a calibration under way offers to searches, corrections, and questions of the duty and of errors."""

import abc
import dataclasses
from typing import TypeVar

import numpy as np
from jaxtyping import Bool

from ...parameters import Transform
from .._least_squares import LeastSquares
from .._task import Task
from ..derivatives import Computation
from ..measurements import SensorsOfTraces
from ._progress import Progress, Report, quiet
from ._search import LevenbergMarquardt

HELD_MATTERS = 9.0
"""Increase of chi^2 from which a value that ran away was worth something: three standard errors of one parameter."""

_Same = TypeVar("_Same", bound="AbstractCalibrator")


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractCalibrator(abc.ABC):
    """A calibration under way; `notes` say what was done with its start.

    `minimiser` searches with what is known of the `sensors`; where it ends, `correct` learns more of them.
    """

    task: Task
    sensors: SensorsOfTraces
    minimiser: LevenbergMarquardt
    notes: tuple[str, ...] = ()

    @abc.abstractmethod
    def at(self: _Same, progress: Progress) -> Computation[_Same]:
        """The same task at another place."""

    @abc.abstractmethod
    def searching_from(self: _Same, progress: Progress, report: Report = quiet) -> Computation[_Same]:
        """A search of the same task to its end, from another place."""

    @abc.abstractmethod
    def corrected(self: _Same, progress: Progress) -> Computation[_Same]:
        """The same task at a place of its corrections, with the derivatives that are known."""

    @abc.abstractmethod
    def correcting(self: _Same) -> Computation[_Same | None]:
        """The next correction of a search that has converged, or `None` where there is none, or none that matters."""

    @abc.abstractmethod
    def corrected_to_its_end(self: _Same, report: Report) -> Computation[_Same]:
        """A search that has ended, after all of its corrections."""

    @abc.abstractmethod
    def linearised_around(self: _Same) -> Computation[_Same]:
        """The same place of its corrections, with derivatives over all that its errors leave possible."""

    @property
    def transform(self) -> Transform:
        """The map between values and the coordinates of the search."""
        return self.minimiser.problem.transform

    def away(self) -> Bool[np.ndarray, " coordinates"]:
        """Which coordinates the search has carried to where nothing is known of them."""
        return self.task.away(self.transform, np.asarray(self.minimiser.progress.coordinates))

    def worth(self, cost: float) -> bool:
        """Whether a difference of costs is evident."""
        return 2 * self.minimiser.problem.count * cost > HELD_MATTERS

    def is_lost(self) -> bool:
        """Whether a search has ended where its values may not be used."""
        progress = self.minimiser.progress
        return not progress.converged or progress.lost or bool(np.any(self.away()))

    def uncertainty(self) -> LeastSquares:
        """Of the linear problem at the current coordinates, without the scatter of corrections."""
        return self.minimiser.uncertainty()


C = TypeVar("C", bound=AbstractCalibrator)
"""A calibrator, of which the same kind comes back."""
