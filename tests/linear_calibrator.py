"""The end of a fit that is linear, so that its errors are known in closed form."""

import dataclasses

import numpy as np

from vgtjax import SimulationError
from vgtjax.estimation import Progress, Unknown
from vgtjax.estimation.search._abstract_calibrator import AbstractCalibrator
from vgtjax.estimation.search._point import Point
from vgtjax.parameters import Transform


@AbstractCalibrator.register  # as far as its errors are asked
@dataclasses.dataclass(frozen=True)
class LinearCalibrator:
    """A calibrator whose residuals are `noise` and change by `sharp` columns where its derivatives say `columns`.
    Simulations fail where the last coordinate is above `fails_beyond`, and are not finite above `breaks_beyond`;
    `chatter` is what residuals of one place have that those of others have not."""

    sharp: np.ndarray
    columns: np.ndarray
    noise: np.ndarray
    progress: Progress
    transform: Transform
    unknown: Unknown = dataclasses.field(default_factory=Unknown)
    fails_beyond: float = np.inf
    breaks_beyond: float = np.inf
    chatter: float = 0.0
    model = None
    fit = (None,)

    @property
    def count(self):
        return len(self.columns)

    @property
    def task(self):
        return self

    @property
    def minimiser(self):
        return self

    @property
    def problem(self):
        return self

    @property
    def point(self):
        here = np.array(self.progress.coordinates)
        seed = int(1e6 * np.abs(here).sum())
        chatter = self.chatter * np.random.default_rng(seed).standard_normal(self.count)
        residuals = self.noise + self.sharp @ here + chatter
        return Point(np.where(here[-1] > self.breaks_beyond, np.nan, residuals), self.columns)

    def uncertainty(self):
        return self.point.uncertainty(self.count)

    def corrected(self, progress):
        if progress.coordinates[-1] > self.fails_beyond:
            raise SimulationError("no simulation there")
        return dataclasses.replace(self, progress=progress)
        yield
