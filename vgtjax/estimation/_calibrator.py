"""A calibration under way: a search, and the corrections that follow it."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError, SimulationError
from .._types import Vector
from ..parameters import Transform
from ..parts import with_sharp_seat
from ..simulation import model_dtype
from ._beginning import first_progress, transform_of
from ._calibration import RUNAWAY, Calibration
from ._corrections import trusted
from ._duty import meets_noise
from ._duty_questions import asking_of_duty
from ._edges import responses_of
from ._evaluation import Evaluation, Steps, ask
from ._evidence import (
    EVIDENT,
    MOST_CORRECTIONS,
    NEARBY,
    SETTLED,
    SHORTEST,
    SMALL_GAIN,
    by_trace,
    learn_sensors,
    observe_traces,
    sharp_bundles,
    turns,
)
from ._finish import finishing
from ._least_squares import LeastSquares
from ._measured import Sensors, white_sensors
from ._point import Point, Slopes
from ._programs import run_alone
from ._progress import LENGTHS, Progress, Report, quiet
from ._residuals import FitProblem, build_fit_problem
from ._search import LevenbergMarquardt
from ._starts import best_of, searching_from, starts_of
from ._task import Task

HELD_MATTERS = 9.0
"""Increase of chi^2 from which a value that ran away was worth something: three standard errors of one parameter."""
MOST_RESCUES = 4
"""Times that a search goes on without what ran away before it is lost."""


@dataclasses.dataclass(frozen=True, eq=False)
class Calibrator:
    """A calibration under way; `notes` say what was done with its start.

    `minimiser` searches with what is known of the `sensors`; where it ends, `correct` learns more of them.
    """

    task: Task
    sensors: Sensors
    minimiser: LevenbergMarquardt
    notes: tuple[str, ...] = ()

    @property
    def transform(self) -> Transform:
        """The map between values and the coordinates of the search."""
        return self.minimiser.problem.transform

    def undetermined(self) -> list[str]:
        """Free entries that the traces do not determine at the current values."""
        known = self.uncertainty().determined.tolist()
        return [entry for entry, is_known in zip(self.task.selection.entries, known, strict=False) if not is_known]

    def run(self, report: Report = quiet) -> Calibration:
        """Steps on to the end, calling `report` after every step."""
        return run_alone(self.steps(report))

    def steps(self, report: Report = quiet) -> Steps[Calibration]:
        """`run` as a computation."""
        calibrator = yield from self.ending(report)
        return (yield from calibrator.finishing())

    def ending(self, report: Report = quiet) -> "Steps[Calibrator]":
        """`run` as a computation, as far as to the end of all steps."""
        calibrator = yield from (yield from self._from_many_starts(report)).searching(report)
        progress = calibrator.minimiser.progress
        if self.task.late_duty and not (progress.corrections or progress.edges):
            calibrator = yield from asking_of_duty(calibrator, report)
        while (following := (yield from calibrator.correcting())) is not None:
            calibrator = following
            report(calibrator.minimiser.progress)
        return calibrator

    def _from_many_starts(self, report: Report) -> "Steps[Calibrator]":
        """The search at the best of the ends that it reaches from many starts, if there are to be several."""
        task, progress = self.task, self.minimiser.progress
        if task.starts < 2 or progress.iteration or progress.waterfall:
            return self
        first = first_progress(task)
        starts = starts_of(task, transform_of(task, first), task.starts)
        ended = yield from searching_from(first, starts, lambda progress: starting(task, progress))
        waterfall = tuple(each.row for each in ended)
        onward = dataclasses.replace(first, coordinates=best_of(ended).coordinates, waterfall=waterfall)
        calibrator = yield from starting(task, onward, self.notes)
        report(calibrator.minimiser.progress)
        return calibrator

    def searching(self, report: Report) -> "Steps[Calibrator]":
        """A search to its end; begun again by moves of other lengths while it gets stuck above the noise.

        What is tried is not reported: a fit that is interrupted meanwhile tries all of it again.
        """
        first = ended = yield from self._searching(report)
        for longest in LENGTHS[1:]:
            if not ended._got_stuck():
                break
            onward = ended.minimiser.progress.begun_again(longest)
            calibrator = yield from starting(self.task, onward, self.notes)
            again = yield from calibrator._searching(quiet)
            ended = min(
                ended, again, key=lambda end: (not end.minimiser.progress.converged, end.minimiser.progress.cost)
            )
        if ended is not first:
            report(ended.minimiser.progress)
        return ended

    def _got_stuck(self) -> bool:
        """Whether a search has ended above the noise where its moves led nowhere."""
        progress = self.minimiser.progress
        smoothly = progress.converged and not progress.stalled
        return not (progress.corrections or smoothly or meets_noise(self.minimiser))

    def _searching(self, report: Report) -> "Steps[Calibrator]":
        """A search to its end, on without what ran away."""
        calibrator = self
        yield from calibrator._search(report)
        for _ in range(MOST_RESCUES):
            onward = yield from calibrator._without_runaways()
            if onward is calibrator:
                break
            calibrator = onward
            yield from calibrator._search(report)
        return calibrator

    def searching_from(self, progress: Progress, report: Report = quiet) -> "Steps[Calibrator]":
        """A search of the same task to its end, from another place."""
        calibrator = yield from starting(self.task, progress, self.notes)
        report(calibrator.minimiser.progress)
        return (yield from calibrator.searching(report))

    def _search(self, report: Report) -> Steps[None]:
        """Steps until the search has ended, and what was held on the way is judged."""
        while not self.minimiser.progress.finished:
            report((yield from self.minimiser.steps()))
        progress = self.minimiser.progress
        if progress.let_go is not None and not progress.corrections:
            self.minimiser.progress = dataclasses.replace(progress, lost=self.worth(progress.cost - progress.let_go))

    def correct(self) -> "Calibrator | None":
        """The next correction of a search that has converged, or `None` where there is none, or none that matters."""
        return run_alone(self.correcting())

    def correcting(self) -> "Steps[Calibrator | None]":
        """`correct` as a computation."""
        progress = self.minimiser.progress
        lost = progress.lost or bool(np.any(self._away()))
        if not (self.task.unknown.anything and progress.converged) or progress.settled or lost:
            return None
        nowhere = np.zeros(len(progress.coordinates))
        if not progress.corrections:
            return (yield from self._try(nowhere, 1.0, nowhere))
        found = self.uncertainty()
        errors = np.where(found.determined, found.std_errors, np.inf)
        step = np.where(found.determined, -found.values, 0.0)
        wanted = (*progress.wanted, tuple(step.tolist()))
        part = 1 / (1 + len(turns(np.array(wanted) / errors)))
        small = bool(np.all(np.abs(part * step) <= SETTLED * errors))
        if not small and progress.corrections < MOST_CORRECTIONS:
            following = yield from self._try(step, part, SETTLED * errors)
            if following is not None:
                return following
            small = found.gain < SMALL_GAIN
        self.minimiser.progress = dataclasses.replace(progress, wanted=wanted, settled=small)
        return None

    def _try(self, step: Vector, part: float, least: Vector) -> "Steps[Calibrator | None]":
        """Corrected after a part of a step, or less of it where the misfit does not bear it out or a simulation fails;
        `None` where that is so for all of it, or what is left moves nothing by more than `least`."""
        search = self.minimiser
        here = np.asarray(search.progress.coordinates)
        while part > SHORTEST:
            there = here
            if np.any(step):
                there = yield from trusted(search.problem, search.point, here, step, part)
                if np.all(np.abs(there - here) <= least):
                    return None
            try:
                return (yield from self._go_on(step, there))
            except SimulationError:
                part /= 4
        return None

    def _away(self) -> Bool[np.ndarray, " coordinates"]:
        """Which coordinates the search has carried to where nothing is known of them."""
        transform, count = self.transform, len(self.task.selection.entries)
        here = np.asarray(self.minimiser.progress.coordinates)
        moved = np.abs(here - np.asarray(transform.to_coordinates(self.task.first_guess)))
        away = (moved > np.log(RUNAWAY)) & transform.positive & ~np.asarray(transform.at_bound(here))
        return away & (np.arange(len(here)) < count)

    def _without_runaways(self) -> "Steps[Calibrator]":
        """The search gone on with what ran away held at its start, as a value that changes nothing spoils no other; or
        freed again, if the search had only lost its way: then holding has made it better."""
        progress, away = self.minimiser.progress, self._away()
        if np.any(away):
            start = np.asarray(self.transform.to_coordinates(self.task.first_guess))
            coordinates = np.where(away, start, np.asarray(progress.coordinates))
            onward = progress.holding(np.flatnonzero(away).tolist(), coordinates.tolist())
        elif progress.let_go is not None and self.worth(progress.let_go - progress.cost):
            onward = progress.freed()
        else:
            return self
        return (yield from starting(self.task, onward, self.notes))

    def worth(self, cost: float) -> bool:
        """Whether a difference of costs is evident."""
        return 2 * self.minimiser.problem.count * cost > HELD_MATTERS

    def is_lost(self) -> bool:
        """Whether a search has ended where its values may not be used."""
        progress = self.minimiser.progress
        return not progress.converged or progress.lost or bool(np.any(self._away()))

    def _go_on(self, step: Vector, there: Vector) -> "Steps[Calibrator]":
        """Corrected at `there` on the way of the step that is wanted, without a delay that may as well be none."""
        progress, errors = self.minimiser.progress, self.uncertainty().std_errors
        coordinates = np.array(there)
        if progress.late and self.task.unknown.duty_delay is not True:
            evident = abs(coordinates[-1]) > EVIDENT * np.nan_to_num(errors[-1])
            coordinates[-1] *= evident
            progress = dataclasses.replace(progress, late=bool(evident))
        slopes = self.minimiser.slopes
        corrected = progress.corrected(coordinates.tolist(), step.tolist(), slopes.at.tolist())
        return (yield from corrected_calibration(self.task, self.minimiser.problem, corrected, slopes, self.notes))

    def uncertainty(self) -> LeastSquares:
        """Of the linear problem at the current coordinates, without the scatter of corrections."""
        return self.minimiser.uncertainty()

    def finish(self) -> Calibration:
        """What came of it: values, covariance, and every trace simulated with them."""
        return run_alone(self.finishing())

    def finishing(self) -> Steps[Calibration]:
        """`finish` as a computation."""
        return (yield from finishing(self.task, self.minimiser, self.sensors, self.notes))


def start_calibration(task: Task, resume: Progress | None = None) -> Calibrator:
    """Compiles a task and evaluates its start.

    **Arguments:** `resume`: the last progress of the same task, interrupted.

    **Raises:** `InputError` for start values outside their bounds; `SimulationError` when the start fails.
    """
    return run_alone(starting(task, resume))


def starting(
    task: Task, resume: Progress | None = None, notes: tuple[str, ...] = (), slopes: Slopes | None = None
) -> Steps[Calibrator]:
    """`start_calibration` as a computation; `slopes` are derivatives where it begins, if they are known."""
    if model_dtype(task.model) != np.float64:
        raise InputError(
            "a fit needs double precision, but the model's parameters are single; call vgtjax.configure() before "
            "anything else, or set jax_enable_x64"
        )
    progress = first_progress(task) if resume is None else resume
    task = dataclasses.replace(task, linear=progress.linear, edges=progress.edges)
    transform = transform_of(task, progress)
    sensors = white_sensors(task.traces, task.channels)
    problem = build_fit_problem(
        task.model,
        task.selection,
        transform,
        task.traces,
        channels=task.channels,
        sensors=sensors,
        stepping=task.stepping,
        prior=task.prior,
    )
    if progress.edges:
        responses = yield from responses_of(task, problem, progress.edges, np.array(progress.edges_seen))
        problem = problem.with_edges(responses, sum(map(len, progress.edges)))
    if not progress.corrections:
        minimiser = yield from LevenbergMarquardt.begin(problem, progress, task.unknown.anything, slopes)
        return Calibrator(task, sensors, minimiser, notes)
    slopes = yield from Slopes.find(problem, np.array(progress.linearised))
    return (yield from corrected_calibration(task, problem, progress, slopes, notes))


def corrected_calibration(
    task: Task, problem: FitProblem, progress: Progress, slopes: Slopes, notes: tuple[str, ...]
) -> Steps[Calibrator]:
    """A calibration among its corrections: what the fit so far tells of sensors and numerical errors goes into it."""
    here = np.array(progress.coordinates)
    problem = dataclasses.replace(problem, transform=transform_of(task, progress))
    asked = problem.evaluation(here)
    smooth = yield from ask(asked)
    observed = by_trace(problem.bundles, smooth)
    exact = observed if not task.unknown.numerics else (yield from _sharp(task, asked))
    sensors = learn_sensors(task.traces, task.channels, observed, exact, task.unknown)
    problem = problem.with_sensors(task.traces, sensors)
    point = Point.of(problem, here, smooth, slopes)
    if point.bend(problem, here, slopes) > NEARBY:
        slopes = yield from Slopes.find(problem, here)
        point = Point.of(problem, here, smooth, slopes)
        progress = dataclasses.replace(progress, linearised=progress.coordinates)
    if len(progress.history) <= progress.iteration:
        progress = dataclasses.replace(progress, history=(*progress.history, 0.5 * point.chi2 / problem.count))
    return Calibrator(task, sensors, LevenbergMarquardt(problem, progress, slopes, point), notes)


def _sharp(task: Task, asked: Evaluation) -> Steps[list[Float[np.ndarray, "time channel"]]]:
    """What would be observed of every trace without a smooth seat and long steps."""
    bundles = sharp_bundles(task.model, task.traces, task.stepping)
    return (yield from observe_traces(with_sharp_seat(asked.model), bundles, asked.delay))


def calibrate(task: Task, report: Report = quiet) -> Calibration:
    """Runs a task to its end, calling `report` after every step.

    **Raises:** as [`start_calibration`][].
    """
    return start_calibration(task).run(report)
