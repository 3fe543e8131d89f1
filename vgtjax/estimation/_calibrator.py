"""A calibration under way: a search, and the corrections that follow it."""

import dataclasses
from collections.abc import Callable

import numpy as np

from .._errors import InputError, SimulationError
from .._types import Vector
from ..parameters import Transform, build_transform, parameter_table
from ..simulation import model_dtype
from ._calibration import RUNAWAY, Calibration, compare
from ._evidence import (
    DELAY_SCALE,
    EVIDENT,
    LONGEST_DELAY,
    LONGEST_STEP,
    MOST_CORRECTIONS,
    SETTLED,
    SHORTEST,
    learn_sensors,
    turns,
)
from ._fit import LevenbergMarquardt, Progress
from ._least_squares import LeastSquares, estimate_uncertainty
from ._residuals import Sensors, build_fit_problem, white_sensors
from ._task import Task


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
        known = self._uncertainty().determined.tolist()
        return [entry for entry, is_known in zip(self.task.selection.entries, known, strict=False) if not is_known]

    def run(self, report: Callable[[Progress], None] = lambda progress: None) -> Calibration:
        """Steps on to the end, calling `report` after every step."""
        while not self.minimiser.progress.finished:
            report(self.minimiser.step())
        calibrator = self
        while (following := calibrator.correct()) is not None:
            calibrator = following
            report(calibrator.minimiser.progress)
        return calibrator.finish()

    def correct(self) -> "Calibrator | None":
        """The next correction of a search that has converged, or `None` where there is none, or none that matters."""
        progress = self.minimiser.progress
        if not (self.task.unknown.anything and progress.converged) or progress.settled or self._ran_away():
            return None
        if not progress.corrections:
            return self._try(np.zeros(len(progress.coordinates)), 1.0)
        found = self._uncertainty()
        errors = np.where(found.determined, found.std_errors, np.inf)
        step = np.where(found.determined, -found.values, 0.0)
        wanted = (*progress.wanted, tuple(step.tolist()))
        part = 1 / (1 + len(turns(np.array(wanted) / errors)))
        settled = bool(np.all(np.abs(part * step) <= SETTLED * errors))
        if settled or progress.corrections >= MOST_CORRECTIONS:
            self.minimiser.progress = dataclasses.replace(progress, wanted=wanted, settled=settled)
            return None
        return self._try(step, min(part, LONGEST_STEP / float(np.max(np.abs(step)))))

    def _try(self, step: Vector, part: float) -> "Calibrator | None":
        """Corrected after a part of a step, or less of it where a simulation fails; `None` where all of them do."""
        while part > SHORTEST:
            try:
                return self._go_on(step, part)
            except SimulationError:
                part /= 4
        return None

    def _ran_away(self) -> bool:
        """Whether the search ended where no correction is worth its while."""
        transform, count = self.transform, len(self.task.selection.entries)
        start = np.asarray(transform.to_coordinates(self.task.first_guess))
        moved = np.abs(np.asarray(self.minimiser.progress.coordinates) - start)
        return bool(np.any((moved > np.log(RUNAWAY))[:count] & transform.positive[:count]))

    def _go_on(self, step: Vector, part: float) -> "Calibrator":
        """Corrected after a part of a step, without a delay of the duty that may as well be none."""
        progress = self.minimiser.progress
        coordinates = np.array(self.transform.clip(np.asarray(progress.coordinates) + part * step))
        if self.task.late_duty and self.task.unknown.duty_delay is not True:
            error = np.nan_to_num(self._uncertainty().std_errors[-1])
            coordinates[-1] *= abs(coordinates[-1]) > EVIDENT * error
        corrected = progress.corrected(coordinates.tolist(), step.tolist())
        return dataclasses.replace(start_calibration(self.task, corrected), notes=self.notes)

    def _uncertainty(self) -> LeastSquares:
        problem = self.minimiser.problem
        return estimate_uncertainty(*self.minimiser.linearisation(), problem.count - problem.offsets)

    def finish(self) -> Calibration:
        """What came of it: values, covariance, and every trace simulated with them."""
        problem, progress = self.minimiser.problem, self.minimiser.progress
        everything, count = self._uncertainty(), len(self.task.selection.entries)
        coordinates = np.asarray(progress.coordinates)
        values = np.asarray(self.transform.to_physical(coordinates))
        slope = np.asarray(self.transform.slope(coordinates))
        model = self.task.selection.unpack(self.task.model, values[:count])
        uncertainty = everything.first(count)
        if progress.wanted:
            # Corrections that go to and fro say how well the numbers themselves are known.
            wanted = np.where(uncertainty.determined, np.array(progress.wanted)[:, :count], 0.0)
            first = turns(wanted / np.where(uncertainty.determined, uncertainty.std_errors, 1.0))[:1]
            last = wanted[int(first[0]) :] if len(first) else wanted[-1:]
            scatter = last.T @ last / len(last)
            uncertainty = dataclasses.replace(uncertainty, covariance=uncertainty.covariance + scatter)
        with np.errstate(over="ignore"):  # the error of a value that ran away may be beyond every number
            covariance = uncertainty.covariance * np.outer(slope[:count], slope[:count])
        late = self.task.late_duty and progress.coordinates[-1] != 0.0
        delay = float(values[-1]) if late else 0.0
        return Calibration(
            model,
            self.task,
            self.transform,
            progress,
            values[:count],
            covariance,
            uncertainty,
            compare(self.task, model, delay, self.sensors),
            problem.count,
            self.sensors,
            delay,
            float(slope[-1] * everything.std_errors[-1]) if late else None,
            self.notes,
        )


def start_calibration(task: Task, resume: Progress | None = None) -> Calibrator:
    """Compiles a task and evaluates its start.

    **Arguments:** `resume`: the last progress of the same task, interrupted.

    **Raises:** `InputError` for start values outside their bounds; `SimulationError` when the start fails.
    """
    if model_dtype(task.model) != np.float64:
        raise InputError(
            "a fit needs double precision, but the model's parameters are single; call vgtjax.configure() before "
            "anything else, or set jax_enable_x64"
        )
    start = np.asarray(task.selection.pack(task.model))
    transform = build_transform(parameter_table(task.model), task.selection.entries, start, task.bounds)
    progress = Progress(()) if resume is None else resume
    if task.late_duty:
        refused = progress.corrections > 0 and progress.coordinates[-1] == 0.0
        longest = 0.0 if refused else LONGEST_DELAY
        transform = transform.extended(DELAY_SCALE, -longest, longest)
    sensors = _sensors_at(task, transform, progress)
    problem = build_fit_problem(
        task.model,
        task.selection,
        transform,
        task.fit,
        channels=task.channels,
        sensors=sensors,
        stepping=task.stepping,
    )
    begin = np.asarray(transform.to_coordinates(task.first_guess)) if resume is None else resume
    return Calibrator(task, sensors, LevenbergMarquardt(problem, begin))


def _sensors_at(task: Task, transform: Transform, progress: Progress) -> Sensors:
    """What is known of the sensors: at first what their signals show, then what is left over."""
    if not progress.corrections:
        return white_sensors(task.fit, task.channels)
    count, values = len(task.selection.entries), np.asarray(transform.to_physical(np.asarray(progress.coordinates)))
    model = task.selection.unpack(task.model, values[:count])
    delay = float(values[-1]) if task.late_duty else None
    return learn_sensors(model, delay, task.fit, task.channels, task.stepping, task.unknown)


def calibrate(task: Task, report: Callable[[Progress], None] = lambda progress: None) -> Calibration:
    """Runs a task to its end, calling `report` after every step.

    **Raises:** as [`start_calibration`][].
    """
    return start_calibration(task).run(report)
