"""Which standard run to record next: by how much each would lower the errors."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ..estimation import CHANNELS, Evaluation, Steps, Task, ask, bundle_traces, run_alone
from ..experiments import STANDARD_RUNS, StandardRun
from ..parameters import build_transform, parameter_table
from ..traces import ASSUMED_RESERVOIR, noise_level
from ._information import Information

LARGEST = 10.0
"""Relative error to which what is not determined is counted: a factor of 20,000 either way is no knowledge."""
MOST_NAMED = 3
"""Entries that a row of the table names."""


@dataclasses.dataclass(frozen=True, eq=False)
class Gain:
    """What a run would bring: `factor` by which errors fall in the geometric mean over all entries, and relative errors
    before and after of those that it helps most, by name; `after` has those of all."""

    run: StandardRun
    factor: float
    lowers: dict[str, tuple[float, float]]
    after: dict[str, float]


def next_runs(task: Task, known: Information, runs: Sequence[StandardRun] | None = None) -> list[Gain]:
    """Standard runs, the one that helps most first; none for a model that no duty drives."""
    return run_alone(ranking(task, known, runs))


def ranking(task: Task, known: Information, runs: Sequence[StandardRun] | None = None) -> Steps[list[Gain]]:
    """`next_runs` as a computation."""
    if "pwm" not in task.model.needs:
        return []
    runs = _sensible(task) if runs is None else runs
    columns = yield from _columns(task, known, runs)
    gains = [_gain(run, known, known.with_more(rows)) for run, rows in zip(runs, columns, strict=True)]
    return sorted(gains, key=lambda gain: -gain.factor)


def _sensible(task: Task) -> list[StandardRun]:
    """Runs without gas, and loops with it where the model feels that."""
    pressures = [float(np.max(trace.p_trb)) for trace in task.fit if trace.p_trb is not None]
    feels = any(entry.startswith("vane_force.") for entry in task.selection.entries)
    gas = sorted({round(each, -2) for each in pressures if each > 0.0}) or [1.5e5, 3.0e5]
    return [*STANDARD_RUNS, *(StandardRun("slow loop", 30.0, 100.0, each) for each in gas if feels)]


def _reservoir(task: Task) -> float:
    recorded = [float(np.mean(trace.p_res)) for trace in task.fit if trace.p_res is not None]
    return float(np.mean(recorded)) if recorded else ASSUMED_RESERVOIR


def _columns(
    task: Task, known: Information, runs: Sequence[StandardRun]
) -> Steps[list[Float[np.ndarray, "rows entries"]]]:
    """What each run would tell, in units of the noise of the sensors that recorded the others.

    Runs that differ in their rate or length only are simulated once, the finest and longest.
    """
    kinds = dict.fromkeys((run.kind, run.turbine_pressure) for run in runs)
    whole = {kind: _finest([run for run in runs if (run.kind, run.turbine_pressure) == kind]) for kind in kinds}
    model = task.selection.unpack(task.model, known.values)
    traces = [run.trace(_reservoir(task)) for run in whole.values()]
    if all(trace.p_act is not None for trace in task.fit) and "pwm" in model.needs:
        # With the same channels they may share the programs of the fit; at rest it is what they begin with anyway.
        traces = [trace.replace(p_act=np.full(len(trace.time), trace.atmosphere)) for trace in traces]
    recorded = bundle_traces(model, task.fit, task.stepping)
    bundles = bundle_traces(model, traces, task.stepping, like=recorded)
    evaluated = yield from ask(Evaluation(model, bundles, None, task.selection))
    if evaluated.failed:
        raise SimulationError("a standard run can't be simulated with these values; check that they are physical")
    found: dict[int, np.ndarray] = {}
    for bundle, lanes in zip(bundles, evaluated.columns, strict=True):
        found |= dict(zip(bundle.indices, bundle.from_lanes(lanes), strict=True))
    slope, noise, order = _slope(task, known), _noise(task), list(whole)
    places = [order.index((run.kind, run.turbine_pressure)) for run in runs]
    return [
        _recorded(run, whole[order[place]], found[place] * slope, noise)
        for run, place in zip(runs, places, strict=True)
    ]


def _finest(runs: Sequence[StandardRun]) -> StandardRun:
    return dataclasses.replace(runs[0], rate=max(run.rate for run in runs), seconds=max(run.seconds for run in runs))


def _recorded(
    run: StandardRun, whole: StandardRun, columns: Float[np.ndarray, "time channel entries"], noise: dict[str, float]
) -> Float[np.ndarray, "rows entries"]:
    """The samples of a run among those of the whole one, weighed, less what an offset of each sensor explains."""
    kept = columns[: round(run.seconds * whole.rate) : round(whole.rate / run.rate)]
    rows = [kept[:, CHANNELS.index(name)] / size for name, size in noise.items()]
    return np.concatenate([each - each.mean(axis=0) for each in rows])


def _slope(task: Task, known: Information) -> Float[np.ndarray, " entries"]:
    """Derivatives of values with respect to the coordinates of `known`."""
    start = np.asarray(task.selection.pack(task.model))
    transform = build_transform(parameter_table(task.model), task.selection.entries, start, {})
    return np.asarray(transform.slope(transform.to_coordinates(known.values)))


def _noise(task: Task) -> dict[str, float]:
    """The median noise of each sensor that is fitted, in m and Pa."""
    levels: dict[str, list[float]] = {}
    for trace in task.fit:
        for name in task.channels:
            if (sampled := trace.sampled(name)) is not None:
                levels.setdefault(name, []).append(noise_level(sampled.value, name))
    return {name: float(np.median(each)) for name, each in levels.items()}


def _gain(run: StandardRun, before: Information, after: Information) -> Gain:
    old, new = ({name: min(error, LARGEST) for name, error in each.errors.items()} for each in (before, after))
    ratios = {name: old[name] / new[name] for name in old if np.isfinite(new[name]) and new[name] > 0.0}
    factor = float(np.exp(np.mean(np.log(list(ratios.values()))))) if ratios else 1.0
    most = sorted(ratios, key=lambda name: -ratios[name])[:MOST_NAMED]
    return Gain(run, factor, {name: (old[name], new[name]) for name in most}, new)
