"""Which standard run to record next: by how much each would lower the errors."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ..estimation import (
    CHANNELS,
    Bundle,
    Computation,
    Evaluation,
    Task,
    ask,
    bundle_traces,
    by_gains,
    longest_like,
    run_alone,
)
from ..experiments import STANDARD_RUNS, StandardRun
from ..parameters import select
from ..parts import OPERATING_POINTS, has_tables
from ..traces import ASSUMED_RESERVOIR, noise_level
from ._information import Information
from ._pieces import Piece, cut, joined

LARGEST = 10.0
"""Relative error to which what is not determined is counted: a factor of 20,000 either way is no knowledge."""
HELPS, TOLD = 0.5, 0.35
"""Part of an error that a run must leave at most to be named for it, and the relative error that it must reach: what is
known to a factor of two at 95 % is determined, if badly."""
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

    def summary(self) -> dict[str, Any]:
        """For JSON; `seconds` in s, `rate` in Hz, `turbine_pressure` in Pa gauge."""
        lowers = {
            name: {"from": before, "to": after, "factor": before / after}
            for name, (before, after) in self.lowers.items()
        }
        run = {name: getattr(self.run, name) for name in ("seconds", "rate", "turbine_pressure")}
        return {"run": self.run.kind, **run, "gain": self.factor, "lowers": lowers}


def next_runs(task: Task, known: Information, runs: Sequence[StandardRun] | None = None) -> list[Gain]:
    """Standard runs, the one that helps most first; none for a model that no duty drives."""
    return run_alone(ranking(task, known, runs))


def ranking(task: Task, known: Information, runs: Sequence[StandardRun] | None = None) -> Computation[list[Gain]]:
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
    gas = sorted({round(each, -2) for each in pressures if each > 0.0}) or OPERATING_POINTS[1:]
    return [*STANDARD_RUNS, *(StandardRun("slow loop", 30.0, 100.0, each) for each in gas if feels)]


def _reservoir(task: Task) -> float:
    recorded = [float(np.mean(trace.p_res)) for trace in task.fit if trace.p_res is not None]
    return float(np.mean(recorded)) if recorded else ASSUMED_RESERVOIR


def _columns(task: Task, known: Information, runs: Sequence[StandardRun]) -> Computation[list[np.ndarray]]:
    """What each run would tell, as rows of [`Information`][], with the noise of the sensors that recorded the others.

    Runs that are the beginning of another, or a part of its samples, are simulated once: the finest and longest; in
    pieces where these have room in the programs of the fit and the whole has not. A slow piece of another run than the
    standard ones may take longer steps than the run would.
    """
    kinds = dict.fromkeys(_course(run) for run in runs)
    whole = {kind: _finest([run for run in runs if _course(run) == kind]) for kind in kinds}
    model = task.selection.unpack(task.model, known.values)
    traces = [run.trace(_reservoir(task)) for run in whole.values()]
    if all(trace.p_act is not None for trace in task.fit) and "pwm" in model.needs:
        # With the same channels they may share the programs of the fit.
        traces = [trace.replace(p_act=np.full(len(trace.time), trace.atmosphere)) for trace in traces]
    recorded = bundle_traces(model, task.fit, task.steps)
    # Of a model with tables each bundle makes its own, for which pieces would need more of them than whole runs.
    uncut = has_tables(model)
    cuts = [[Piece(trace, 0)] if uncut else cut(trace, longest_like(trace, recorded)) for trace in traces]
    pieces = [piece.trace for pieces in cuts for piece in pieces]
    bundles = [_balanced(each) for each in bundle_traces(model, pieces, task.steps, like=recorded)]
    evaluated = yield from ask(Evaluation(model, bundles, None, task.selection))
    if evaluated.failed:
        raise SimulationError(f"a standard run can't be simulated with these values. {evaluated.failure}")
    slope, noise = _slope(task, known), _noise(task)
    parts = [[each * slope for each in evaluated.columns], [by_gains(task, each) for each in evaluated.observed]]
    if task.tolerances:
        held = yield from ask(Evaluation(model, bundles, None, select(model, list(task.tolerances))))
        parts.append([each * list(task.tolerances.values()) for each in held.columns])
    found: dict[int, np.ndarray] = {}
    for bundle, *lanes in zip(bundles, *parts, strict=True):
        found |= dict(zip(bundle.indices, bundle.from_lanes(np.concatenate(lanes, axis=-1)), strict=True))
    shown = iter(found[index] for index in range(len(pieces)))
    courses = {kind: joined(pieces, [next(shown) for _ in pieces]) for kind, pieces in zip(whole, cuts, strict=True)}
    return [_recorded(run, whole[_course(run)], courses[_course(run)], noise) for run in runs]


def _balanced(bundle: Bundle) -> Bundle:
    """The same runs with no measured pressure at their beginning: at rest, or in balance with the first duty."""
    unknown = np.zeros_like(bundle.start.pressure_known)
    return dataclasses.replace(bundle, start=dataclasses.replace(bundle.start, pressure_known=unknown))


def _course(run: StandardRun) -> tuple[str, float, float]:
    """What runs have in common of which one is a part of another: random levels whatever their length."""
    return run.kind, run.turbine_pressure, np.inf if run.kind == "levels" else run.seconds


def _finest(runs: Sequence[StandardRun]) -> StandardRun:
    return dataclasses.replace(runs[0], rate=max(run.rate for run in runs), seconds=max(run.seconds for run in runs))


def _recorded(
    run: StandardRun, whole: StandardRun, shown: Float[np.ndarray, "time channel columns"], noise: dict[str, float]
) -> Float[np.ndarray, "rows columns"]:
    """The samples of a run among those of the whole one, the nearest ones, weighed, less what an offset of each sensor
    explains."""
    places = np.round(np.arange(round(run.seconds * run.rate)) * (whole.rate / run.rate)).astype(int)
    kept = shown[np.minimum(places, len(shown) - 1)]
    rows = [kept[:, CHANNELS.index(name)] / size for name, size in noise.items()]
    return np.concatenate([each - each.mean(axis=0) for each in rows])


def _slope(task: Task, known: Information) -> Float[np.ndarray, " entries"]:
    """Derivatives of values with respect to the coordinates of `known`."""
    transform = task.transform({})
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


def remedies(known: Information, gains: Sequence[Gain]) -> list[str]:
    """For each entry that hardly shows or not at all, the shortest sentence on the run that would help it most; nothing
    of one that no run would determine."""
    said: dict[str, list[str]] = {}
    for name in [*known.without_effect, *dict.fromkeys(name for group, _ in known.nearly_null for name in group)]:
        best = min(gains, key=lambda gain: gain.after[name], default=None)
        if best is not None and best.after[name] < min(HELPS * known.errors[name], TOLD):
            said.setdefault(best.run.label, []).append(f"{name} to {100 * best.after[name]:.2g} %")
    return [f"a run of {label} would determine {', '.join(names)}" for label, names in said.items()]
