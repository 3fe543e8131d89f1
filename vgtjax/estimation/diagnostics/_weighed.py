"""A finished fit in the weights of any sensors: residuals, their derivatives, and what each stretch of time says."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float, Int

from .._calibration import Calibration
from .._comparison import comparing
from .._least_squares import NULL_OF_GRAM, LeastSquares, estimate_uncertainty, finite_columns, reduce_rows
from ..derivatives import CHANNELS, Computation, Evaluated
from ..measurements import FitProblem, SensorsOfTraces
from ..search import LevenbergMarquardt, Progress, Slopes, problem_of, transform_of

BLOCKS = 16
"""Stretches of a trace that count as independent of each other: few enough that residuals forget from one to the next,
many enough that three traces show the scatter between them."""
MOST_STEPS = 30
"""Steps of a search in the weights of other sensors, which begins near its end."""
FARTHEST = 100.0
"""Times the range of its own signal by which a unit of all coordinates may move a sample. Where derivatives say more
they have exploded, as they do where a fit has not settled and has none of other places: of one campaign the best
structure seemed to have five values that traces determine, and others, with the same chi^2, fifty."""
TOLD_BY_OTHERS = 0.2
"""Part of the information on a direction that the other traces must have for it to move when a trace is left out. Where
they have a part of it, chi^2 of the trace left out has the inverse of that part in the mean, and as much more or less
by chance: with a hundredth, the wrong structure of one campaign seemed better by 400, and with a fifth worse by 44, as
the whole fits have it (39)."""

Blocks = Float[np.ndarray, " blocks"]


@dataclasses.dataclass(frozen=True, eq=False)
class Linearised:
    """A calibration, and what its traces do with its free values around the end of the fit.

    With a duty that may be late its delay is the last coordinate, also where the fit found none.
    """

    calibration: Calibration
    problem: FitProblem
    at: Float[np.ndarray, " coordinates"]
    evaluated: Evaluated

    @staticmethod
    def of(calibration: Calibration) -> Computation["Linearised"]:
        """As a computation: the derivatives where the fit has ended."""
        at, late = np.array(calibration.progress.coordinates), dataclasses.replace(calibration.progress, late=True)
        problem = problem_of(calibration.task, late)
        slopes = yield from Slopes.find(_own(problem, calibration), at)
        return Linearised(calibration, problem, at, (yield from _with_delay(problem, slopes, calibration)))

    def _with_noise(self, sensors: SensorsOfTraces) -> FitProblem:
        """The problem with the noise of these sensors; values have this fit's own numerical errors taken away."""
        own = [
            {name: dataclasses.replace(sensor, values=mine[name].values) for name, sensor in each.items()}
            for each, mine in zip(sensors, self.calibration.sensors, strict=True)
        ]
        return self.problem.with_sensors(self.calibration.task.traces, own)

    def searched(self, sensors: SensorsOfTraces) -> Computation["Linearised"]:
        """Where the search ends in the weights of these sensors, which are not those of the fit itself."""
        problem = _own(self._with_noise(sensors), self.calibration)
        search = yield from LevenbergMarquardt.begin(problem, Progress(tuple(self.at.tolist())))
        while not search.progress.finished and search.progress.iteration < MOST_STEPS:
            yield from search.steps()
        at, task = np.array(search.progress.coordinates), self.calibration.task
        model, delay = self.problem.at(at)
        compared = yield from comparing(task, model, 0.0 if delay is None else float(delay), self.calibration.sensors)
        calibration = dataclasses.replace(self.calibration, traces=compared)
        evaluated = yield from _with_delay(self.problem, search.slopes, calibration)
        return dataclasses.replace(self, calibration=calibration, at=at, evaluated=evaluated)

    @functools.cached_property
    def _believed(self) -> list[np.ndarray]:
        """Derivatives of what is observed without those that have exploded; else an offset that a trace is less would
        spread one of them over all of it."""
        slope, found = np.asarray(self.problem.transform.slope(self.at)), []
        ranges = np.array(
            [
                [np.ptp(each[name].values) if name in each else 0.0 for name in CHANNELS]
                for each in self.calibration.sensors
            ]
        )
        for bundle, columns in zip(self.problem.bundles, self.evaluated.columns, strict=True):
            farthest = FARTHEST * ranges[bundle.numbers[bundle.lane_trace]]
            with np.errstate(over="ignore", invalid="ignore"):
                sizes = np.linalg.norm(columns * slope, axis=-1)
            believed = sizes <= farthest[:, None]
            found.append(columns if np.all(believed) else np.where(believed[..., None], columns, 0.0))
        return found

    def weighed(self, sensors: SensorsOfTraces) -> "Weighed":
        """Seen with the noise of these sensors."""
        problem = self._with_noise(sensors)
        residuals = problem.residuals_of(self.evaluated.observed)
        columns = finite_columns(problem.columns_of(self._believed, self.at))
        prior, distances = np.zeros((0, len(self.at))), np.zeros(0)
        if problem.prior is not None:
            prior, distances = np.diag(problem.prior.precision), np.asarray(problem.prior.residuals(self.at))
        pinned = np.asarray(problem.transform.pinned(self.at, residuals @ columns + distances @ prior))
        columns, prior = (np.where(pinned, 0.0, each) for each in (columns, prior))
        trace, block = _owners(problem)
        return Weighed(residuals, columns, distances, prior, trace, block, problem.count - problem.offsets)


def _own(problem: FitProblem, calibration: Calibration) -> FitProblem:
    """A problem as the fit has searched it: a duty that this took for timely stays so."""
    return dataclasses.replace(problem, transform=transform_of(calibration.task, calibration.progress))


def _with_delay(problem: FitProblem, slopes: Slopes, calibration: Calibration) -> Computation[Evaluated]:
    """What is observed, and its derivatives, that with respect to the delay of the duty included. Where the fit took
    that for timely it is asked by itself, as the fit has done: another program would compile for ten seconds."""
    if problem.late_duty and not calibration.progress.late:
        slopes = yield from slopes.with_delay(problem)
    return dataclasses.replace(slopes.evaluated, columns=slopes.columns)


def _owners(problem: FitProblem) -> tuple[Int[np.ndarray, " rows"], Int[np.ndarray, " rows"]]:
    """The trace and the block that every residual belongs to."""
    blocks = []
    for bundle in problem.bundles:
        owner, segment = bundle.lane_trace[: bundle.owned], bundle.lane_segment[: bundle.owned]
        part = BLOCKS * segment // np.bincount(owner)[owner]
        blocks.append(np.repeat(BLOCKS * np.array(bundle.indices)[owner] + part, bundle.rows // bundle.owned))
    return problem.owner, np.concatenate(blocks)


@dataclasses.dataclass(frozen=True, eq=False)
class Weighed:
    """Residuals in units of the sensors' noise, their derivatives, and the trace and the block that each is in.

    `distances` from what is known beforehand and their derivatives, `prior`, are in no trace. `count` is the number of
    measurements less that of the offsets.
    """

    residuals: Float[np.ndarray, " rows"]
    columns: Float[np.ndarray, "rows coordinates"]
    distances: Float[np.ndarray, " known"]
    prior: Float[np.ndarray, "known coordinates"]
    trace: Int[np.ndarray, " rows"]
    block: Int[np.ndarray, " rows"]
    count: int

    @functools.cached_property
    def uncertainty(self) -> LeastSquares:
        """Of the linear problem; its `gain` is what a full linear step promises."""
        few, columns = reduce_rows(self.residuals, self.columns)
        residuals, columns = np.append(few, self.distances), np.vstack([columns, self.prior])
        return estimate_uncertainty(residuals, columns, self.count, len(self.distances))

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)

    @functools.cached_property
    def rank(self) -> int:
        """Number of directions that the traces determine, whatever is known beforehand."""
        if not len(self.distances):
            return self.uncertainty.rank
        return estimate_uncertainty(*reduce_rows(self.residuals, self.columns), self.count).rank

    def misfit(self, scale: float = 1.0) -> float:
        """`chi2` of noise with the variance `scale`, and the squared distances from what is known beforehand."""
        return self.chi2 / scale + float(self.distances @ self.distances)

    @functools.cached_property
    def by_block(self) -> Blocks:
        """`chi2` block by block."""
        return np.bincount(self.block, self.residuals**2, BLOCKS * (int(self.trace.max()) + 1))

    @functools.cached_property
    def left_out(self) -> Blocks:
        """`by_block` of every trace when it is left out of the fit, to first order.

        The others, and what is known beforehand, take a full linear step from where the fit is, which need not be the
        end of the linear problem: columns are means over places. Directions that they do not tell stay where the whole
        fit has them.
        """
        everything = np.vstack([self.columns, self.prior])
        lengths = np.linalg.norm(everything, axis=0)
        everything /= np.where(lengths > 0, lengths, 1.0)
        sizes, directions = np.linalg.eigh(everything.T @ everything)
        known = sizes > NULL_OF_GRAM * max(float(sizes.max()), 1e-300)
        everything = everything @ (directions[:, known] / np.sqrt(sizes[known]))  # all rows together tell one of each
        columns, moved = everything[: len(self.columns)], self.residuals.copy()
        whole = everything.T @ np.append(self.residuals, self.distances)
        for trace in np.unique(self.trace):
            mine = self.trace == trace
            here = columns[mine]
            others, ways = np.linalg.eigh(np.eye(here.shape[1]) - here.T @ here)
            told = others > TOLD_BY_OTHERS
            pull = ways[:, told].T @ (whole - here.T @ self.residuals[mine])
            moved[mine] -= here @ (ways[:, told] @ (pull / others[told]))
        return np.bincount(self.block, moved**2, len(self.by_block))
