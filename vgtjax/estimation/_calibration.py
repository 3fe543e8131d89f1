"""A calibration from start to finish: which parameters, which traces, and what came of them."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from .._printing import Cells, Printed
from .._types import Vector
from ..parameters import (
    Bounds,
    Selection,
    Transform,
    bounds_by_entry,
    build_transform,
    parameter_table,
    replace_parameters,
    select,
    table_row,
)
from ..plants import AbstractModel, MechanicalActuator
from ..simulation import FixedStep, model_dtype
from ..traces import SIGNALS, Trace
from ._bundle import CHANNELS
from ._evidence import (
    DELAY_SCALE,
    EVIDENT,
    LONGEST_DELAY,
    LONGEST_STEP,
    MOST_CORRECTIONS,
    NOTHING,
    SETTLED,
    Unknown,
    learn_sensors,
    observe_traces,
    turns,
)
from ._fit import LevenbergMarquardt, Progress
from ._least_squares import LeastSquares, estimate_uncertainty
from ._residuals import Sensors, build_fit_problem, white_sensors
from ._sensors import Sensor

RUNAWAY = 1e5
"""Factor by which a positive value may leave its start. In fits of twenty actuators none moves by more than 10^1.7;
from a hopeless start a fit goes to where nothing changes any more, converges there, and leaves a mass of 1e88 kg."""


NORMAL_95 = 1.959964
"""Standard errors on either side that hold 95 % of a normal distribution."""


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """What to calibrate: a model with its start values, the free entries, and the traces.

    `bounds` are by entry, in the units of the table; `channels` the measured signals to fit; `unknown` is what the fit
    finds out besides.
    """

    model: AbstractModel
    selection: Selection
    fit: Sequence[Trace]
    validate: Sequence[Trace] = ()
    bounds: Bounds = dataclasses.field(default_factory=dict)
    channels: Sequence[str] = CHANNELS
    stepping: FixedStep = dataclasses.field(default_factory=FixedStep)
    unknown: Unknown = NOTHING

    @property
    def late_duty(self) -> bool:
        """Whether the duty may be late."""
        return bool(self.unknown.duty_delay) and "pwm" in self.model.needs


def plan_task(
    model: AbstractModel,
    fit: Sequence[Trace],
    validate: Sequence[Trace] = (),
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    values: dict[str, Any] | None = None,
    bounds: Bounds | None = None,
    channels: Sequence[str] | None = None,
    unknown: Unknown = NOTHING,
) -> Task:
    """Puts a task together from names.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns; all that is not held by default, and `fixed` beats `free`.
    - `values`: start values by name, in the units of the table.
    - `bounds`: `(lower, upper)` by name or entry, either `None`.
    - `channels`: measured signals to fit; by default those that are no input of the model.
    - `unknown`: what the fit finds out besides the parameters; nothing by default.

    **Raises:** `InputError` for unknown names, and when no trace is to be fitted.
    """
    if not fit:
        raise InputError("a fit needs at least one trace, but there is none; give one", "traces")
    model = replace_parameters(model, values or {})
    if channels is None:
        channels = ("x_d",) if isinstance(model, MechanicalActuator) else CHANNELS
    return Task(
        model,
        select(model, free, fixed),
        fit,
        validate,
        bounds_by_entry(model, bounds or {}),
        channels,
        unknown=unknown,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """One channel of a trace against a model, at the channel's own valid samples, each array `(samples,)`.

    `time` in s; `measured`, `simulated` in m or Pa, and `noise`, the standard deviation of the sensor's.
    """

    time: Float[np.ndarray, " samples"]
    measured: Float[np.ndarray, " samples"]
    simulated: Float[np.ndarray, " samples"]
    noise: float

    @property
    def offset(self) -> float:
        """Constant offset of the sensor, sensor minus model."""
        return float(np.mean(self.measured - self.simulated))

    @property
    def residual(self) -> Float[np.ndarray, " samples"]:
        """What remains without the offset."""
        return self.measured - self.offset - self.simulated

    @property
    def rmse(self) -> float:
        """Root mean square of what remains."""
        return float(np.std(self.measured - self.simulated))


@dataclasses.dataclass(frozen=True, eq=False)
class TraceResult:
    """How a fitted model meets one trace.

    `simulated` has each observed signal at the trace's `time`; `channels` compares those that were measured.
    """

    trace: Trace
    use: str
    simulated: dict[str, np.ndarray]
    channels: dict[str, Comparison]

    @property
    def rmse(self) -> dict[str, float]:
        """What remains after the constant offset, by channel, in m and Pa."""
        return {name: channel.rmse for name, channel in self.channels.items()}

    @property
    def offset(self) -> dict[str, float]:
        """Constant offset of each sensor, sensor minus model, in m and Pa."""
        return {name: channel.offset for name, channel in self.channels.items()}

    @property
    def noise(self) -> dict[str, float]:
        """The sensors' own noise that the fit took, by channel, in m and Pa."""
        return {name: channel.noise for name, channel in self.channels.items()}

    @property
    def failed(self) -> bool:
        """Whether the simulation left the finite numbers."""
        return not all(map(np.isfinite, self.rmse.values()))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration(Printed):
    """A finished calibration; vectors are in the order of `selection.entries` and in the units of the table.

    It prints itself as a table. `notes` say what the fit did with its start.
    """

    model: AbstractModel
    task: Task
    transform: Transform
    progress: Progress
    values: Float[np.ndarray, " parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    uncertainty: LeastSquares
    traces: list[TraceResult]
    count: int
    """Number of measurements fitted."""
    sensors: Sensors
    """What the fit found out of the sensors of every trace fitted, by channel."""
    duty_delay: float = 0.0
    """s by which the duty reaches the valve later than its record says."""
    duty_delay_error: float | None = None
    """Its standard error in s; `None` where it was not fitted."""
    notes: tuple[str, ...] = ()

    def _title(self) -> str:
        word = "converged" if self.converged else "NOT converged"
        steps = self.progress.iteration
        return f"Calibration: {word} after {steps} step{'' if steps == 1 else 's'}; {self.verdict}"

    def _tables(self) -> list[Cells]:
        return [self._estimates(), self._comparisons()]

    def _estimates(self) -> Cells:
        table, rows = parameter_table(self.model), [("parameter", "value", "std. error", "unit", "")]
        found = zip(self.task.selection.entries, self.values, self.std_errors, self.at_bound, strict=True)
        for entry, value, error, at_bound in found:
            unknown = not np.isfinite(error)
            status = "at bound" if at_bound else "not determined" if unknown else "free"
            unit = str(table_row(table, entry).unit)
            rows.append((entry, f"{value:.6g}", "" if unknown else f"{error:.2g}", unit, status))
        return rows

    def _comparisons(self) -> Cells:
        channels = self.task.channels
        units = (SIGNALS[channel].unit.split()[0] for channel in channels)  # a difference of pressures is not absolute
        heads = (f"RMSE of {channel}, {unit}" for channel, unit in zip(channels, units, strict=True))
        rows: list[tuple[str, ...]] = [("trace", "use", *heads)]
        for result in self.traces:
            errors = (result.rmse.get(channel) for channel in channels)
            rows.append((result.trace.name, result.use, *("" if error is None else f"{error:.3g}" for error in errors)))
        return rows

    @property
    def converged(self) -> bool:
        """Whether the search came to an end whose values may be used."""
        return self.progress.converged and not self.troubles

    @property
    def verdict(self) -> str:
        """What is wrong with the values, or else why the search ended."""
        return "; ".join(self.troubles) or self.progress.verdict

    @property
    def troubles(self) -> tuple[str, ...]:
        """A sentence on each thing that is wrong with the values, however the search ended."""
        troubles = []
        if failed := [result.trace.name for result in self.traces if result.failed]:
            names = ", ".join(failed)
            troubles.append(f"the simulation of {names} with the fitted values left the finite numbers")
        if away := self.ran_away:
            table, entries = parameter_table(self.model), self.task.selection.entries
            start = np.asarray(self.task.selection.pack(self.task.model))
            ends = [
                f"{entry} ended at {value:.4g} {table_row(table, entry).unit} (start {begin:.4g})"
                for entry, value, begin in zip(entries, self.values, start, strict=True)
                if entry in away
            ]
            troubles.append(
                f"fitted values must stay within a factor {RUNAWAY:g} of their start values, but {', '.join(ends)}; "
                "give bounds or better start values"
            )
        return tuple(troubles)

    @property
    def at_bound(self) -> Bool[np.ndarray, " parameters"]:
        """Which values lie on a bound."""
        return np.asarray(self.transform.at_bound(np.asarray(self.progress.coordinates)))[: len(self.values)]

    @property
    def ran_away(self) -> tuple[str, ...]:
        """Entries whose positive value ended more than a factor `RUNAWAY` from its start, and on no bound."""
        count = len(self.values)
        start = np.asarray(self.transform.to_coordinates(_first_guess(self.task)))[:count]
        # Coordinates are logarithms, finite where a value has left the range of floating point.
        moved = np.abs(np.asarray(self.progress.coordinates)[:count] - start)
        away = self.transform.positive[:count] & (moved > np.log(RUNAWAY)) & ~self.at_bound
        return tuple(np.array(self.task.selection.entries)[away].tolist())

    @property
    def shifts(self) -> Float[np.ndarray, " parameters"]:
        """By how many of its standard errors corrections for sensors and numerical errors moved each value."""
        if not self.progress.corrections:
            return np.where(self.uncertainty.determined, 0.0, np.nan)
        moved = (np.asarray(self.progress.coordinates) - np.asarray(self.progress.found))[: len(self.values)]
        return moved / self.uncertainty.std_errors

    @property
    def intervals(self) -> Float[np.ndarray, "parameters 2"]:
        """Ends within which each value lies with 95 % confidence; those of positive values by their logarithm.

        NaN where the data say nothing.
        """
        reach = NORMAL_95 * self.uncertainty.std_errors[:, None] * np.array([-1.0, 1.0])
        linear = self.values[:, None] + reach * self.transform.scale[: len(self.values), None]
        with np.errstate(over="ignore"):
            return np.where(
                self.transform.positive[: len(self.values), None], self.values[:, None] * np.exp(reach), linear
            )

    @property
    def std_errors(self) -> Float[np.ndarray, " parameters"]:
        """Standard errors; NaN where the data say nothing."""
        return np.where(self.uncertainty.determined, np.sqrt(np.diag(self.covariance)), np.nan)


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
        if not (self.task.unknown.anything and progress.converged) or progress.settled:
            return None
        if not progress.corrections:
            return self._go_on(np.zeros(len(progress.coordinates)), 1.0)
        found = self._uncertainty()
        errors = np.where(found.determined, found.std_errors, np.inf)
        step = np.where(found.determined, -found.values, 0.0)
        wanted = (*progress.wanted, tuple(step.tolist()))
        part = 1 / (1 + len(turns(np.array(wanted) / errors)))
        settled = bool(np.all(np.abs(part * step) <= SETTLED * errors))
        if settled or progress.corrections >= MOST_CORRECTIONS:
            self.minimiser.progress = dataclasses.replace(progress, wanted=wanted, settled=settled)
            return None
        return self._go_on(step, min(part, LONGEST_STEP / float(np.max(np.abs(step)))))

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
    begin = np.asarray(transform.to_coordinates(_first_guess(task))) if resume is None else resume
    return Calibrator(task, sensors, LevenbergMarquardt(problem, begin))


def _first_guess(task: Task) -> Float[np.ndarray, " coordinates"]:
    """Start values, and a duty that is not late where it may be."""
    return np.append(np.asarray(task.selection.pack(task.model)), np.zeros(int(task.late_duty)))


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


def compare(task: Task, model: AbstractModel, delay: float = 0.0, sensors: Sensors | None = None) -> list[TraceResult]:
    """Simulates every trace of a task and compares it with what was measured.

    **Arguments:** `delay` of the duty in s; `sensors` of the traces to fit, by default as their signals show them.
    """
    uses = [("fit", trace) for trace in task.fit] + [("validate", trace) for trace in task.validate]
    traces = [trace for _, trace in uses]
    observed = observe_traces(model, traces, task.stepping, delay or None)
    known = white_sensors(traces, task.channels)
    known = known if sensors is None else [*sensors, *known[len(sensors) :]]
    return [_compare_one(trace, use, observed[i], known[i]) for i, (use, trace) in enumerate(uses)]


def _compare_one(trace: Trace, use: str, observed: np.ndarray, sensors: dict[str, Sensor]) -> TraceResult:
    simulated = dict(zip(CHANNELS, observed.T, strict=True))
    compared = {}
    for name, sensor in sensors.items():
        sampled = trace.sampled(name)
        if sampled is not None:
            compared[name] = Comparison(sampled.time, sampled.value, simulated[name][trace.rows(name)], sensor.level)
    return TraceResult(trace, use, simulated, compared)
