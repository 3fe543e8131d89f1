"""What came of a calibration: values, errors, and how every trace is met."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from .._printing import Cells, Printed
from ..parameters import Transform, parameter_table, table_row, unknown_name
from ..plants import AbstractModel
from ..traces import SIGNALS, Trace
from ._comparison import TraceResult
from ._estimate import Estimate, estimate_table
from ._least_squares import NORMAL_95, LeastSquares
from ._task import RUNAWAY, Task
from .errors import Budget, taken_for_exact
from .measurements import FoundDuty, InputSensor, SensorsOfTraces, in_seconds, left_over_noise, sample_interval
from .search import Progress


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration(Printed):
    """A finished calibration; vectors are in the order of `selection.entries` and in the units of the table.

    `calibration["diaphragm.stiffness"]` is the [`Estimate`][vgtjax.estimation.Estimate] of one entry, and
    `calibration.trace("step_80")` how one trace is met; over itself it has the names of its entries.

    It prints itself as tables, and below them `notes`, which say what the fit did with its start, `findings`, and what
    its errors take for exact.
    """

    model: AbstractModel
    task: Task
    transform: Transform
    progress: Progress
    values: Float[np.ndarray, " parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    """Of the errors of `values`; zeros where the data say nothing, see `error_covariance`."""
    uncertainty: LeastSquares
    traces: list[TraceResult]
    count: int
    """Number of measurements fitted."""
    sensors: SensorsOfTraces
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
        return [estimate_table(self.estimates), self.comparisons]

    def _sentences(self) -> list[str]:
        return self.sentences

    @property
    def sentences(self) -> list[str]:
        """What is to be said besides the tables."""
        return [*self.notes, *self.findings, *taken_for_exact(self.task)]

    @property
    def comparisons(self) -> Cells:
        """A row of texts for every trace, how it is met, below a header."""
        channels = self.task.channels
        units = (SIGNALS[channel].unit.split()[0] for channel in channels)  # a difference of pressures is not absolute
        heads = (f"RMSE of {channel}, {unit}" for channel, unit in zip(channels, units, strict=True))
        rows: list[tuple[str, ...]] = [("trace", "use", *heads)]
        for result in self.traces:
            errors = (result.rmse.get(channel) for channel in channels)
            rows.append((result.trace.name, result.use, *("" if error is None else f"{error:.3g}" for error in errors)))
        return rows

    @functools.cached_property
    def estimates(self) -> dict[str, Estimate]:
        """What was found of every free entry, by its name and in the order of `selection.entries`."""
        table = parameter_table(self.task.model)
        whole = np.all(np.isfinite(self.intervals), axis=1, keepdims=True)
        ends = np.where(whole, self.intervals, np.nan)
        columns = (each.tolist() for each in (self.values, self.std_errors, ends, self.at_bound, self.determined))
        return {
            entry: Estimate(value, str(table_row(table, entry).unit), error, (low, high), at_bound, determined)
            for entry, value, error, (low, high), at_bound, determined in zip(
                self.task.selection.entries, *columns, strict=True
            )
        }

    def __getitem__(self, entry: str) -> Estimate:
        """What was found of a free entry, such as `"diaphragm.stiffness"` or `"converter.magnetic_force[2]"`.

        **Raises:** `InputError` for a name that no free entry has.
        """
        if entry not in self.estimates:
            raise unknown_name("free entry", entry, self.estimates)
        return self.estimates[entry]

    def __iter__(self) -> Iterator[str]:
        return iter(self.estimates)

    def trace(self, name: str) -> TraceResult:
        """How the first trace of a name is met, fitted or for validation.

        **Raises:** `InputError` for a name that no trace has.
        """
        for result in self.traces:
            if result.trace.name == name:
                return result
        raise unknown_name("trace", name, [result.trace.name for result in self.traces])

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

    def found_duty(self, trace: Trace) -> FoundDuty:
        """What was found of the duty of a trace, of a fitted one its edges as well."""
        linear = self.duty_hold(trace) == "linear"
        return FoundDuty(self.duty_delay, linear, tuple(self.late_edges(trace)))

    def applied(self, trace: Trace) -> Trace:
        """A trace with the duty that reached the valve: as late as it was found, linear between samples if it was so,
        and with its edges where they were. `model` simulated along that is what the fit shows of the trace."""
        return self.found_duty(trace).applied(trace)

    def input_sensor(self, trace: Trace) -> InputSensor | None:
        """What was found of the sensor of the pressure that drives a fitted trace; `None` where no pressure does."""
        found = zip((each.name for each in self.task.fit), self.task.inputs, strict=False)
        return dict(found).get(trace.name)

    @property
    def instruments(self) -> dict[str, tuple[float, float]]:
        """Gains of sensors, offsets of inputs and start states that were free, each with its standard error, by entry.

        The error is NaN where the data say nothing.
        """
        return {
            entry: (found.value, found.std_error)
            for entry, found in self.estimates.items()
            if entry.startswith(("gain.", "offset.", "initial."))
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
            start = dict(zip(self, self.task.selection.values(self.task.model).tolist(), strict=True))
            ended = {entry: self[entry] for entry in away}
            ends = [
                f"{entry} ended at {found.value:.4g} {found.unit} (start {start[entry]:.4g})"
                for entry, found in ended.items()
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
        return self.uncertainty.determined(self.transform.positive[: len(self.values)])

    @property
    def ran_away(self) -> tuple[str, ...]:
        """Entries whose positive value ended more than a factor `RUNAWAY` from its start, and on no bound."""
        away = self.task.away(self.transform, np.asarray(self.progress.coordinates))
        return tuple(itertools.compress(self.task.selection.entries, away))

    @property
    def shifts(self) -> Float[np.ndarray, " parameters"]:
        """By how many of its standard errors corrections for sensors and numerical errors moved each value."""
        if not self.progress.corrections:
            return np.where(self.uncertainty.estimable, 0.0, np.nan)
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
    def error_covariance(self) -> Float[np.ndarray, "parameters parameters"]:
        """`covariance` with NaN in the rows and columns of values of which the data say nothing, as a population of
        fits takes it."""
        known = self.uncertainty.estimable
        return np.where(known & known[:, None], self.covariance, np.nan)

    @property
    def std_errors(self) -> Float[np.ndarray, " parameters"]:
        """Standard errors; NaN where the data say nothing."""
        return np.sqrt(np.diag(self.error_covariance))
