"""What came of a calibration: values, errors, and how every trace is met."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from .._printing import Cells, Printed
from ..parameters import Transform, parameter_table, table_row
from ..plants import AbstractModel
from ..traces import SIGNALS, Trace
from ._least_squares import NORMAL_95, LeastSquares
from ._task import RUNAWAY, Task
from .derivatives import CHANNELS, Bundle, Computation, Evaluation, ask, bundle_traces, run_alone
from .errors import Budget, taken_for_exact
from .measurements import (
    InputSensor,
    Sensor,
    Sensors,
    by_trace,
    in_seconds,
    left_over_noise,
    read_duties,
    sample_interval,
    white_sensors,
)
from .search import Progress


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """One channel of a trace against a model, at the channel's own valid samples, each array `(samples,)`.

    `time` in s; `measured`, `simulated` in m or Pa, and `noise`, the standard deviation of the sensor's. `error` is the
    standard error of `simulated` by those of the parameters, to first order; `None` where these are not known.
    """

    time: Float[np.ndarray, " samples"]
    measured: Float[np.ndarray, " samples"]
    simulated: Float[np.ndarray, " samples"]
    noise: float
    error: Float[np.ndarray, " samples"] | None = None

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

    @property
    def peak(self) -> float:
        """The largest of what remains."""
        return float(np.max(np.abs(self.residual)))


@dataclasses.dataclass(frozen=True, eq=False)
class TraceResult:
    """How a fitted model meets one trace.

    `simulated` has each observed signal at the trace's `time`; `channels` compares those that were measured. `failure`
    says why its simulation failed, and what helps.
    """

    trace: Trace
    use: str
    simulated: dict[str, np.ndarray]
    channels: dict[str, Comparison]
    failure: str = ""

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
        """Whether the simulation failed."""
        return bool(self.failure)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration(Printed):
    """A finished calibration; vectors are in the order of `selection.entries` and in the units of the table.

    It prints itself as tables, and below them `notes`, which say what the fit did with its start, `findings`, and what
    its errors take for exact.
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
    budget: Budget
    """Where the standard errors come from."""
    duty_delay: float = 0.0
    """s by which the duty reaches the valve later than its record says."""
    duty_delay_error: float | None = None
    """Its standard error in s; `None` where it was not fitted."""
    notes: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    """What it found out besides the parameters, and how it meets the traces: a sentence each."""

    def _title(self) -> str:
        word = "converged" if self.converged else "NOT converged"
        steps = self.progress.iteration
        return f"Calibration: {word} after {steps} step{'' if steps == 1 else 's'}; {self.verdict}"

    def _tables(self) -> list[Cells]:
        return [self._estimates(), self._comparisons()]

    def _sentences(self) -> list[str]:
        return [*self.notes, *self.findings, *taken_for_exact(self.task)]

    def _estimates(self) -> Cells:
        table, rows = parameter_table(self.task.model), [("parameter", "value", "std. error", "unit", "")]
        columns = (self.values, self.std_errors, self.at_bound, self.determined)
        for entry, value, error, at_bound, known in zip(self.task.selection.entries, *columns, strict=True):
            status = "at bound" if at_bound else "free" if known else "not determined"
            unit = str(table_row(table, entry).unit)
            rows.append((entry, f"{value:.6g}", f"{error:.2g}" if np.isfinite(error) else "", unit, status))
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

    def duty_hold(self, trace: Trace) -> str:
        """How the duty of a trace is between its samples, as it was found or as the trace says: `linear` or
        `zero-order`."""
        linear = trace.duty_hold == "linear" or sample_interval(trace) in self.progress.linear
        return "linear" if linear else "zero-order"

    def late_edges(self, trace: Trace) -> list[float]:
        """By how many seconds each of the edges of the duty of a fitted trace is later than recorded, beside a delay of
        the duty; none where that was not found."""
        late = dict(zip((each.name for each in self.task.fit), self.progress.edges, strict=False))
        return in_seconds(trace, late.get(trace.name, ()))

    def input_sensor(self, trace: Trace) -> InputSensor | None:
        """What was found of the sensor of the pressure that drives a fitted trace; `None` where no pressure does."""
        found = zip((each.name for each in self.task.fit), self.task.inputs, strict=False)
        return dict(found).get(trace.name)

    @property
    def instruments(self) -> dict[str, tuple[float, float]]:
        """Gains of sensors, offsets of inputs and start states that were free, each with its standard error, by entry.

        The error is NaN where the data say nothing.
        """
        found = zip(self.task.selection.entries, self.values.tolist(), self.std_errors.tolist(), strict=True)
        return {
            entry: (value, error) for entry, value, error in found if entry.startswith(("gain.", "offset.", "initial."))
        }

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
        if failed := {result.trace.name: result.failure for result in self.traces if result.failed}:
            why = " ".join(dict.fromkeys(failed.values())).removesuffix(".")
            troubles.append(f"the simulation of {', '.join(failed)} with the fitted values failed: {why}")
        if self.progress.lost:
            names = ", ".join(self.task.selection.entries[number] for number in self.progress.held)
            troubles.append(
                f"fitted values must stay within a factor {RUNAWAY:g} of their start values, but {names} ran away, and "
                "held at the start value the fit is worse; give bounds or better start values"
            )
        if away := self.ran_away:
            table, entries = parameter_table(self.task.model), self.task.selection.entries
            start = self.task.selection.values(self.task.model)
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
        """Which values lie on a bound; those that ran away and are held lie on none."""
        at_bound = np.array(self.transform.at_bound(np.asarray(self.progress.coordinates)))[: len(self.values)]
        at_bound[list(self.progress.held)] = False
        return at_bound

    @property
    def determined(self) -> Bool[np.ndarray, " parameters"]:
        """Which values the traces determine: they show them, and positive ones to a factor of ten to either side."""
        return self.uncertainty.tells(self.transform.positive[: len(self.values)])

    @property
    def ran_away(self) -> tuple[str, ...]:
        """Entries whose positive value ended more than a factor `RUNAWAY` from its start, and on no bound."""
        away = self.task.away(self.transform, np.asarray(self.progress.coordinates))
        return tuple(itertools.compress(self.task.selection.entries, away))

    @property
    def shifts(self) -> Float[np.ndarray, " parameters"]:
        """By how many of its standard errors corrections for sensors and numerical errors moved each value."""
        if not self.progress.corrections:
            return np.where(self.uncertainty.determined, 0.0, np.nan)
        moved = (np.asarray(self.progress.coordinates) - np.asarray(self.progress.found))[: len(self.values)]
        return moved / self.uncertainty.std_errors

    @property
    def noise_ratios(self) -> dict[tuple[str, str], float]:
        """What remains of each channel of each fitted trace, by their names, in units of the noise that it has to meet
        (`noise_to_meet`): root mean squares, without samples that are outliers, of which one in two hundred would
        double it."""
        found = {}
        fitted = (result for result in self.traces if result.use == "fit")
        for result, sensors in zip(fitted, self.sensors, strict=True):
            for channel, met in result.channels.items():
                measured = result.trace.sampled(channel)
                assert measured is not None, "what is compared was measured"
                found[result.trace.name, channel] = left_over_noise(
                    sensors[channel], measured, channel, met.measured - met.simulated
                )
        return found

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


def compare(task: Task, model: AbstractModel, delay: float = 0.0, sensors: Sensors | None = None) -> list[TraceResult]:
    """Simulates every trace of a task and compares it with what was measured.

    **Arguments:** `delay` of the duty in s; `sensors` of the traces to fit, by default as their signals show them.
    """
    return run_alone(comparing(task, model, delay, sensors))


def comparing(
    task: Task,
    model: AbstractModel,
    delay: float = 0.0,
    sensors: Sensors | None = None,
    errors: Sequence[np.ndarray] | None = None,
) -> Computation[list[TraceResult]]:
    """`compare` as a computation; `errors` `(time, channel)` of what is observed of every trace as the task reads it,
    those to fit first. Edges are where they are beside this delay, which may be a little beyond that of the task."""
    results, bundles = [], list[Bundle]()
    left: Iterator[np.ndarray | None] = itertools.repeat(None) if errors is None else iter(errors)
    for use, traces, edges in (("fit", task.fit, task.edges), ("validate", task.validate, ())):
        read = read_duties(traces, task.linear, edges, delay)
        bundles = bundle_traces(model, read, task.steps, bundles)
        evaluated = yield from ask(Evaluation(model, bundles, delay or None))
        observed, failures = by_trace(bundles, evaluated), evaluated.failures(bundles)
        known = sensors if use == "fit" and sensors is not None else white_sensors(traces, task.channels)
        of_errors = task.traces if use == "fit" else read
        of_each = zip(traces, read, of_errors, observed, known, failures, strict=True)
        for trace, applied, before, seen, each, failure in of_each:
            error = next(left)
            error = None if error is None else error[before.rows_at(trace.time)]
            compared = _compare_one(trace, use, seen[applied.rows_at(trace.time)], each, error)
            results.append(dataclasses.replace(compared, failure=failure))
    return results


def _compare_one(
    trace: Trace, use: str, observed: np.ndarray, sensors: dict[str, Sensor], errors: np.ndarray | None
) -> TraceResult:
    simulated = dict(zip(CHANNELS, observed.T, strict=True))
    compared = {}
    for name, sensor in sensors.items():
        sampled = trace.sampled(name)
        if sampled is not None:
            rows = trace.rows(name)
            error = None if errors is None else errors[rows, CHANNELS.index(name)]
            compared[name] = Comparison(sampled.time, sampled.value, simulated[name][rows], sensor.level, error)
    return TraceResult(trace, use, simulated, compared)
