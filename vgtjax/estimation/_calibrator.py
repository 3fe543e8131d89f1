"""A calibration under way: a search, and the corrections that follow it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..parts import with_sharp_seat
from ..simulation import model_dtype
from ._calibration import Calibration
from ._finish import Lacking, finishing
from ._task import Task
from .derivatives import WIDE, Computation, Evaluation, ask, run_alone
from .duty import (
    NEAR_ENOUGH,
    asking_beside_edges,
    asking_of_duty,
    edges_of,
    find_edges,
    moved,
    reading_both_ways,
    unanswered,
    unanswered_directions,
)
from .measurements import (
    NEARBY,
    FitProblem,
    by_trace,
    learn_sensors,
    observe_traces,
    sharp_bundles,
    simulated,
    white_sensors,
)
from .search import (
    AbstractCalibrator,
    LevenbergMarquardt,
    Point,
    Progress,
    Report,
    Slopes,
    beginning_again,
    by_delay_alone,
    correcting,
    first_progress,
    from_many_starts,
    from_second_guess,
    giving_up,
    places_around,
    problem_of,
    quiet,
    searching,
    searching_once,
    transform_of,
    without_ceiling,
)

MISPLACED = 1e-4
"""s by which a delay may move before edges are read at other times; of a duty late by less the mean is taken."""


@dataclasses.dataclass(frozen=True, eq=False)
class Calibrator(AbstractCalibrator):
    """A calibration under way, which searches, asks its questions of the duty, and corrects itself."""

    _first_correction: "tuple[Progress, Calibrator | None] | None" = dataclasses.field(default=None, init=False)

    def not_estimable(self) -> list[str]:
        """Free entries in null directions at the current values: others make up for them, or no trace shows them."""
        known = self.uncertainty().estimable.tolist()
        return [entry for entry, is_known in zip(self.task.selection.entries, known, strict=False) if not is_known]

    def run(self, report: Report = quiet) -> Calibration:
        """Steps on to the end, calling `report` after every step."""
        return run_alone(self.steps(report))

    def steps(self, report: Report = quiet) -> Computation[Calibration]:
        """`run` as a computation."""
        calibrator = yield from self.ending(report)
        return (yield from calibrator.finishing())

    def ending(self, report: Report = quiet) -> "Computation[Calibrator]":
        """`run` as a computation, as far as to the end of all steps."""
        begin = yield from without_ceiling((yield from from_many_starts(self, report)))
        first = yield from searching_once(begin, report)
        first = yield from giving_up((yield from from_second_guess(first, report)), report)
        progress = first.minimiser.progress
        if progress.given_up:
            return first
        if progress.corrections or not self.task.late_duty:
            calibrator = yield from beginning_again(first, report)
        elif progress.edges:
            calibrator = yield from asking_beside_edges((yield from beginning_again(first, report)), report)
        else:
            calibrator = yield from asking_of_duty(first, report)
        calibrator = yield from calibrator.corrected_to_its_end(report)
        return (yield from reading_both_ways(calibrator, report))

    def at(self, progress: Progress) -> "Computation[Calibrator]":
        """The same task at another place."""
        return (yield from starting(self.task, progress, self.notes))

    def corrected(self, progress: Progress) -> "Computation[Calibrator]":
        """The same task at a place of its corrections, with the derivatives that are known."""
        search = self.minimiser
        return (yield from corrected_calibration(self.task, search.problem, progress, search.slopes, self.notes))

    def searching_from(self, progress: Progress, report: Report = quiet) -> "Computation[Calibrator]":
        """A search of the same task to its end, from another place."""
        calibrator = yield from self.at(progress)
        report(calibrator.minimiser.progress)
        return (yield from searching(calibrator, report))

    def corrected_to_its_end(self, report: Report) -> "Computation[Calibrator]":
        """A search that has ended, after all of its corrections."""
        calibrator = self
        while (following := (yield from calibrator.correcting())) is not None:
            calibrator = following
            report(calibrator.minimiser.progress)
        return calibrator

    def linearised_around(self) -> "Computation[Calibrator]":
        """The same place of its corrections, with derivatives over all that its errors leave possible."""
        search = self.minimiser
        here, clip = np.array(search.progress.coordinates), search.problem.transform.clip
        around = [np.asarray(clip(place)) for place in places_around(self.uncertainty(), here)]
        slopes = yield from Slopes.find(search.problem, here, around)
        progress = search.progress.linearised_around(place.tolist() for place in around)
        point = Point.of(search.problem, here, slopes.evaluated, slopes)
        return dataclasses.replace(self, minimiser=LevenbergMarquardt(search.problem, progress, slopes, point))

    def correct(self) -> "Calibrator | None":
        """The next correction of a search that has converged, or `None` where there is none, or none that matters."""
        return run_alone(self.correcting())

    def correcting(self) -> "Computation[Calibrator | None]":
        """`correct` as a computation; the first correction, which moves nothing, is asked for by several questions and
        made once."""
        progress = self.minimiser.progress
        if progress.corrections:
            return (yield from correcting(self))
        if self._first_correction is None or self._first_correction[0] is not progress:
            object.__setattr__(self, "_first_correction", (progress, (yield from correcting(self))))
        assert self._first_correction is not None, "it has just been made"
        return self._first_correction[1]

    def finish(self) -> Calibration:
        """What came of it: values, covariance, and every trace simulated with them."""
        return run_alone(self.finishing())

    def finishing(self) -> Computation[Calibration]:
        """`finish` as a computation."""
        lacking = Lacking((yield from unanswered(self)), (yield from unanswered_directions(self)))
        return (yield from finishing(self.task, self.minimiser, self.sensors, self.notes, lacking))


def start_calibration(task: Task, resume: Progress | None = None) -> Calibrator:
    """Compiles a task and evaluates its start.

    **Arguments:** `resume`: the last progress of the same task, interrupted.

    **Raises:** `InputError` for start values outside their bounds; `SimulationError` when the start fails.
    """
    return run_alone(starting(task, resume))


def starting(
    task: Task, resume: Progress | None = None, notes: tuple[str, ...] = (), slopes: Slopes | None = None
) -> Computation[Calibrator]:
    """`start_calibration` as a computation; `slopes` are derivatives where it begins, if they are known."""
    if model_dtype(task.model) != np.float64:
        raise InputError(
            "a fit needs double precision, but the model's parameters are single; call vgtjax.configure() before "
            "anything else, or set jax_enable_x64"
        )
    progress = first_progress(task) if resume is None else resume
    delay = _delay_of(task, progress, progress.edges_seen) if progress.edges else 0.0
    task = dataclasses.replace(task, linear=progress.linear, edges=progress.edges, edges_delay=delay)
    task = dataclasses.replace(task, finer=progress.finer)
    sensors = white_sensors(task.traces, task.channels)
    problem = problem_of(task, progress, sensors)
    if progress.edges:
        edges = yield from edges_of(task, problem, progress.edges, np.array(progress.edges_seen), delay=progress.late)
        problem = problem.with_edges(edges)
    if not progress.corrections:
        minimiser = yield from LevenbergMarquardt.begin(problem, progress, task.unknown.anything, slopes)
        return Calibrator(task, sensors, minimiser, notes)
    around = [np.array(place) for place in progress.around]
    slopes = yield from Slopes.find(problem, np.array(progress.linearised), around)
    return (yield from corrected_calibration(task, problem, progress, slopes, notes))


def _delay_of(task: Task, progress: Progress, coordinates: Sequence[float]) -> float:
    """The delay of the duty in s at coordinates of a search."""
    return float(transform_of(task, progress).scale[-1]) * coordinates[-1] if progress.late else 0.0


def asked_first(task: Task) -> list[Evaluation]:
    """The question by which a fit starts."""
    problem, here = _at_start(task)
    return [problem.evaluation(here, slopes=True)]


def foreseen_certificate(task: Task) -> list[Evaluation]:
    """What the gradient certificate of a fit asks in the end; it takes the longest to compile."""
    problem, here = _at_start(task)
    nothing = [np.zeros(np.shape(each.values)) for each in problem.measured]
    return [dataclasses.replace(problem.evaluation(here, slopes=True), cotangent=nothing)]


def _at_start(task: Task) -> tuple[FitProblem, Float[np.ndarray, " coordinates"]]:
    """The problem of a search at its start, and where that is."""
    progress = first_progress(task)
    return problem_of(task, progress), np.array(progress.coordinates)


def foreseen(task: Task) -> list[list[Evaluation]]:
    """What a fit asks soon after its start."""
    progress = first_progress(task)
    problem = problem_of(task, progress)
    plain = problem.evaluation(np.array(progress.coordinates))
    exact = dataclasses.replace(
        plain, model=with_sharp_seat(plain.model), bundles=sharp_bundles(task.model, task.traces, task.stepping)
    )
    sharp = [[exact]] if task.unknown.numerics else []
    return [[plain] * WIDE, [plain], *sharp, *_foreseen_of_delay(task, problem, progress)]


def _foreseen_of_delay(task: Task, problem: FitProblem, progress: Progress) -> list[list[Evaluation]]:
    """What the question is asked by whether a duty is late that was taken for timely."""
    if progress.late or not task.late_duty:
        return []
    late = dataclasses.replace(problem, transform=transform_of(task, dataclasses.replace(progress, late=True)))
    return [[by_delay_alone(late, np.array(progress.coordinates))]]


def corrected_calibration(
    task: Task, problem: FitProblem, progress: Progress, slopes: Slopes, notes: tuple[str, ...]
) -> Computation[Calibrator]:
    """A calibration among its corrections: what the fit so far tells of sensors and numerical errors goes into it."""
    here = np.array(progress.coordinates)
    problem = dataclasses.replace(problem, transform=transform_of(task, progress))
    asked = problem.evaluation(here)
    placed = simulated((yield from ask(asked)), problem.bundles, task.traces)
    smooth = problem.beside_edges(placed, here)
    observed = by_trace(problem.bundles, smooth)
    exact = observed
    if task.unknown.numerics:
        defects = zip((yield from _sharp(task, asked)), by_trace(problem.bundles, placed), observed, strict=True)
        exact = [seen + sharp - without for sharp, without, seen in defects]
    sensors = learn_sensors(task.traces, task.channels, observed, exact, task.unknown)
    problem = problem.with_sensors(task.traces, sensors)
    point = Point.of(problem, here, smooth, slopes)
    resumed = bool(progress.around) and progress.linearised == progress.coordinates
    if task.edges and progress.edges_seen != progress.coordinates and not resumed:
        found = find_edges(problem, slopes, (here, smooth))
        beyond = abs(_delay_of(task, progress, progress.coordinates) - task.edges_delay)
        if beyond > MISPLACED or found.farthest > NEAR_ENOUGH:
            return (yield from starting(task, progress.seeing_edges(moved(progress.edges, found.late)), notes))
    if not progress.around and point.bend(problem, here, slopes) > NEARBY:
        slopes = yield from Slopes.find(problem, here)
        point = Point.of(problem, here, smooth, slopes)
        progress = progress.linearised_around(())
    if len(progress.history) <= progress.iteration:
        progress = dataclasses.replace(progress, history=(*progress.history, 0.5 * point.chi2 / problem.count))
    return Calibrator(task, sensors, LevenbergMarquardt(problem, progress, slopes, point), notes)


def _sharp(task: Task, asked: Evaluation) -> Computation[list[Float[np.ndarray, "time channel"]]]:
    """What would be observed of every trace without a smooth seat and long steps."""
    bundles = sharp_bundles(task.model, task.traces, task.stepping)
    return (yield from observe_traces(with_sharp_seat(asked.model), bundles, task.traces, asked.delay))


def calibrate(task: Task, report: Report = quiet) -> Calibration:
    """Runs a task to its end, calling `report` after every step.

    **Raises:** as [`start_calibration`][].
    """
    return start_calibration(task).run(report)
