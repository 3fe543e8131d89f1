"""Every trace against a model: what is simulated of it beside what was measured."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ..plants import AbstractModel
from ..simulation import RESULTS, first_failure
from ..traces import Trace
from ._task import Task
from .derivatives import CHANNELS, Bundle, Computation, Evaluation, ask, bundle_traces, run_alone
from .measurements import SensorNoise, SensorsOfTraces, by_trace, read_duties, white_sensors


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

    `simulated` has each observed signal at the trace's `time`; `channels` compares those that were measured. `result`
    says how its simulation ended.
    """

    trace: Trace
    use: str
    simulated: dict[str, np.ndarray]
    channels: dict[str, Comparison]
    result: RESULTS

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

    @property
    def failure(self) -> str:
        """Why its simulation failed, and what helps; empty where it did not."""
        return first_failure(self.result)


def compare(
    task: Task, model: AbstractModel, delay: float = 0.0, sensors: SensorsOfTraces | None = None
) -> list[TraceResult]:
    """Simulates every trace of a task and compares it with what was measured.

    **Arguments:** `delay` of the duty in s; `sensors` of the traces to fit, by default as their signals show them.
    """
    return run_alone(comparing(task, model, delay, sensors))


def comparing(
    task: Task,
    model: AbstractModel,
    delay: float = 0.0,
    sensors: SensorsOfTraces | None = None,
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
        observed, ends = by_trace(bundles, evaluated), evaluated.results(bundles)
        known = sensors if use == "fit" and sensors is not None else white_sensors(traces, task.channels)
        of_errors = task.traces if use == "fit" else read
        of_each = zip(traces, read, of_errors, observed, known, ends, strict=True)
        for trace, applied, before, seen, each, end in of_each:
            error = next(left)
            error = None if error is None else error[before.rows_at(trace.time)]
            results.append(_compare_one(trace, use, seen[applied.rows_at(trace.time)], each, error, end))
    return results


def _compare_one(
    trace: Trace,
    use: str,
    observed: np.ndarray,
    sensors: dict[str, SensorNoise],
    errors: np.ndarray | None,
    result: RESULTS,
) -> TraceResult:
    simulated = dict(zip(CHANNELS, observed.T, strict=True))
    compared = {}
    for name, sensor in sensors.items():
        sampled = trace.sampled(name)
        if sampled is not None:
            rows = trace.rows(name)
            error = None if errors is None else errors[rows, CHANNELS.index(name)]
            compared[name] = Comparison(sampled.time, sampled.value, simulated[name][rows], sensor.level, error)
    return TraceResult(trace, use, simulated, compared, result)
