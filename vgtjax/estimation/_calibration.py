"""A calibration from start to finish: which parameters, which traces, and what came of them."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from .._printing import Cells, Printed
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
from ..traces import SIGNALS, Trace, noise_level
from ._bundle import CHANNELS, bundle_traces
from ._fit import LevenbergMarquardt, Progress
from ._least_squares import LeastSquares, estimate_uncertainty
from ._residuals import build_fit_problem
from ._sensitivities import observe

RUNAWAY = 1e5
"""Factor by which a positive value may leave its start. In fits of twenty actuators none moves by more than 10^1.7;
from a hopeless start a fit goes to where nothing changes any more, converges there, and leaves a mass of 1e88 kg."""


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """What to calibrate: a model with its start values, the free entries, and the traces.

    `bounds` are by entry, in the units of the table; `channels` the measured signals to fit.
    """

    model: AbstractModel
    selection: Selection
    fit: Sequence[Trace]
    validate: Sequence[Trace] = ()
    bounds: Bounds = dataclasses.field(default_factory=dict)
    channels: Sequence[str] = CHANNELS
    stepping: FixedStep = dataclasses.field(default_factory=FixedStep)


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
) -> Task:
    """Puts a task together from names.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns; all that is not held by default, and `fixed` beats `free`.
    - `values`: start values by name, in the units of the table.
    - `bounds`: `(lower, upper)` by name or entry, either `None`.
    - `channels`: measured signals to fit; by default those that are no input of the model.

    **Raises:** `InputError` for unknown names, and when no trace is to be fitted.
    """
    if not fit:
        raise InputError("a fit needs at least one trace, but there is none; give one", "traces")
    model = replace_parameters(model, values or {})
    if channels is None:
        channels = ("x_d",) if isinstance(model, MechanicalActuator) else CHANNELS
    return Task(model, select(model, free, fixed), fit, validate, bounds_by_entry(model, bounds or {}), channels)


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
        return np.asarray(self.transform.at_bound(np.asarray(self.progress.coordinates)))

    @property
    def ran_away(self) -> tuple[str, ...]:
        """Entries whose positive value ended more than a factor `RUNAWAY` from its start, and on no bound."""
        start = self.transform.to_coordinates(self.task.selection.pack(self.task.model))
        # Coordinates are logarithms, finite where a value has left the range of floating point.
        moved = np.abs(np.asarray(self.progress.coordinates) - np.asarray(start))
        away = self.transform.positive & (moved > np.log(RUNAWAY)) & ~self.at_bound
        return tuple(np.array(self.task.selection.entries)[away].tolist())

    @property
    def std_errors(self) -> Float[np.ndarray, " parameters"]:
        """Standard errors; NaN where the data say nothing."""
        return np.where(self.uncertainty.determined, np.sqrt(np.diag(self.covariance)), np.nan)


@dataclasses.dataclass(frozen=True, eq=False)
class Calibrator:
    """A calibration under way; `notes` say what was done with its start."""

    task: Task
    transform: Transform
    minimiser: LevenbergMarquardt
    notes: tuple[str, ...] = ()

    def undetermined(self) -> list[str]:
        """Free entries that the traces do not determine at the current values."""
        found = estimate_uncertainty(*self.minimiser.linearisation(), self.minimiser.problem.count)
        return [entry for entry, known in zip(self.task.selection.entries, found.determined, strict=True) if not known]

    def run(self, report: Callable[[Progress], None] = lambda progress: None) -> Calibration:
        """Steps on to the end, calling `report` after every step."""
        while not self.minimiser.progress.finished:
            report(self.minimiser.step())
        return self.finish()

    def finish(self) -> Calibration:
        """What came of it: values, covariance, and every trace simulated with them."""
        residuals, columns = self.minimiser.linearisation()
        problem, progress = self.minimiser.problem, self.minimiser.progress
        uncertainty = estimate_uncertainty(residuals, columns, problem.count - problem.offsets)
        coordinates = np.asarray(progress.coordinates)
        values = np.asarray(self.transform.to_physical(coordinates))
        slope = np.asarray(self.transform.slope(coordinates))
        model = self.task.selection.unpack(self.task.model, values)
        with np.errstate(over="ignore"):  # the error of a value that ran away may be beyond every number
            covariance = uncertainty.covariance * np.outer(slope, slope)
        return Calibration(
            model,
            self.task,
            self.transform,
            progress,
            values,
            covariance,
            uncertainty,
            compare(self.task, model),
            problem.count,
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
    problem = build_fit_problem(
        task.model, task.selection, transform, task.fit, channels=task.channels, stepping=task.stepping
    )
    if resume is None:
        minimiser = LevenbergMarquardt(problem, np.asarray(transform.to_coordinates(start)))
    else:
        minimiser = LevenbergMarquardt(problem, resume)
    return Calibrator(task, transform, minimiser)


def calibrate(task: Task, report: Callable[[Progress], None] = lambda progress: None) -> Calibration:
    """Runs a task to its end, calling `report` after every step.

    **Raises:** as [`start_calibration`][].
    """
    return start_calibration(task).run(report)


def compare(task: Task, model: AbstractModel) -> list[TraceResult]:
    """Simulates every trace of a task and compares it with what was measured."""
    uses = [("fit", trace) for trace in task.fit] + [("validate", trace) for trace in task.validate]
    traces = [trace for _, trace in uses]
    observed: dict[int, np.ndarray] = {}
    for bundle in bundle_traces(model, traces, task.stepping):
        observed |= dict(zip(bundle.indices, bundle.from_lanes(np.asarray(observe(model, bundle))), strict=True))
    return [_compare_one(trace, use, observed[i], task.channels) for i, (use, trace) in enumerate(uses)]


def _compare_one(trace: Trace, use: str, observed: np.ndarray, channels: Sequence[str]) -> TraceResult:
    simulated = dict(zip(CHANNELS, observed.T, strict=True))
    compared = {}
    for name in channels:
        sampled = trace.sampled(name)
        if sampled is not None:
            rows, noise = trace.rows(name), noise_level(sampled.value, name)
            compared[name] = Comparison(sampled.time, sampled.value, simulated[name][rows], noise)
    return TraceResult(trace, use, simulated, compared)
