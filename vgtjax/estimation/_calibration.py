"""A calibration from start to finish: which parameters, which traces, and what came of them."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from ..parameters import (
    Selection,
    Transform,
    build_transform,
    match_entries,
    parameter_table,
    replace_parameters,
    select,
)
from ..plants import AbstractModel
from ..simulation import FixedStep, model_dtype
from ..traces import Trace, noise_level
from ._bundle import CHANNELS, bundle_traces
from ._fit import LevenbergMarquardt, Progress
from ._least_squares import LeastSquares, estimate_uncertainty
from ._residuals import build_fit_problem
from ._sensitivities import observe

Bounds = dict[str, tuple[float | None, float | None]]

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
    channels: Sequence[str] = CHANNELS,
) -> Task:
    """Puts a task together from names.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns; all that is not held by default, and `fixed` beats `free`.
    - `values`: start values by name, in the units of the table.
    - `bounds`: `(lower, upper)` by name or entry, either `None`; for the model itself its own names.

    **Raises:** `InputError` for unknown names, and when no trace is to be fitted.
    """
    if not fit:
        raise InputError("a fit needs at least one trace to be fitted, but there is none; give one", "fit")
    model = replace_parameters(model, values or {})
    table = parameter_table(model)
    by_entry = {entry: pair for name, pair in (bounds or {}).items() for entry in sorted(match_entries(table, [name]))}
    return Task(model, select(model, free, fixed), fit, validate, by_entry, channels)


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


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """A finished calibration; vectors are in the order of `selection.entries` and in the units of the table."""

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
    """A calibration under way."""

    task: Task
    transform: Transform
    minimiser: LevenbergMarquardt

    def unidentifiable(self) -> list[str]:
        """Free entries that the traces do not determine at the current values."""
        found = estimate_uncertainty(*self.minimiser.linearisation(), self.minimiser.problem.count)
        return [entry for entry, seen in zip(self.task.selection.entries, found.determined, strict=True) if not seen]

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
    calibrator = start_calibration(task)
    while not calibrator.minimiser.progress.finished:
        report(calibrator.minimiser.step())
    return calibrator.finish()


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
