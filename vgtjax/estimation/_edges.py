"""Edges of a duty between the samples of its record.

A record that is slower than the duty shows an edge at the first sample after it: each edge was earlier, by another part
of a sample. What that moves is a column of the least squares for every edge, which is eliminated like the offset of a
sensor, with a sample as what is known of it beforehand.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..traces import Trace
from ._bundle import CHANNELS, bundle_traces
from ._duties import Late, read_duties
from ._evaluation import Evaluation, Steps, ask, side_by_side
from ._evidence import by_trace
from ._holds import sample_interval
from ._least_squares import reduce_rows
from ._point import Point, Slopes
from ._residuals import FitProblem
from ._search import SPREAD
from ._task import Task

NUDGE = 0.2
"""Samples by which an edge is moved to see what that moves."""
NEAR_ENOUGH, ROUNDS = 0.05, 4
"""Samples by which no edge moves any more, and searches until then at most."""
ON_TIME = 0.75
"""Quantile of all edges that is taken for one that is recorded on time; the last ones may be late by noise."""
DIFFER = 0.1
"""Samples of standard deviation from which edges are not all as late. At any millisecond of a record with 500 Hz it is
a quarter; where all are half a sample early, noise leaves 0.06 (`test_edges.py`)."""
LARGEST, SHOWN = 3.0, 2.0
"""Deviations above which a residual is an outlier, and standard errors beyond chance from which an edge may be
somewhere else: chi^2 was 154 and 167 of 12 edges on two traces with every second sample, 9 to 12 with all of them."""
WIDEST = 1.2
"""Samples over which the edges of one trace may lie: a record shows each at the first sample behind it, so over one and
what noise adds. Good fits of a group of 25 had up to 1.08; searches that had taken a late duty for a lighter plunger
scattered them over 1.12 to 2.2."""
EVIDENT_EDGE = 9.0
"""Gain in chi^2 that each edge must bring in the mean: three standard errors."""


def responses_of(
    task: Task, problem: FitProblem, late: Late, at: Float[np.ndarray, " coordinates"]
) -> Steps[list[np.ndarray]]:
    """What is observed of every bundle when an edge is a sample later, `(lanes, sample, channel, edges)`; the column
    `j` of a lane is that of edge `j` of its trace.

    One simulation of all traces moves an edge in each of them. Where one fails, its edges are taken to move nothing.
    """
    asked = problem.evaluation(at)
    count = max(map(len, late))
    read = [read_duties(task.fit, (), moved) for moved in (late, *(_nudged(late, edge) for edge in range(count)))]
    answers = yield from side_by_side([_seen(task, asked, each) for each in read], at_once=len(SPREAD))
    here, *there = ([np.asarray(seen) for seen in each] for each in answers)
    columns = [
        np.stack([_differences(each[index], base) for each in there], axis=-1) for index, base in enumerate(here)
    ]
    rows = [trace.rows_at(recorded.time) for trace, recorded in zip(task.traces, task.fit, strict=True)]
    return [bundle.to_lanes(columns, rows) for bundle in problem.bundles]


def _seen(task: Task, asked: Evaluation, read: Sequence[Trace]) -> Steps[list[np.ndarray]]:
    """What is observed of traces with their edges somewhere else, at the times of their records."""
    bundles = bundle_traces(task.model, read, task.stepping)
    evaluated = yield from ask(dataclasses.replace(asked, bundles=bundles))
    found = zip(by_trace(bundles, evaluated), read, task.fit, strict=True)
    return [observed[trace.rows_at(recorded.time)] for observed, trace, recorded in found]


def _nudged(late: Late, edge: int) -> Late:
    """With one edge of every trace that has so many earlier."""
    return tuple(tuple(value - NUDGE * (number == edge) for number, value in enumerate(each)) for each in late)


def _differences(there: np.ndarray, here: np.ndarray) -> np.ndarray:
    difference = (here - there) / NUDGE
    return np.where(np.isfinite(difference), difference, 0.0)


def show_in(problem: FitProblem, slopes: Slopes, traces: Sequence[Trace]) -> bool:
    """Whether residuals tell of edges somewhere else: a cheap question before that for what each edge moves.

    An edge that is later makes all later that comes behind it, so residuals are compared with the slope in time of what
    is observed until the next edge; outliers are cut.
    """
    observed = by_trace(problem.bundles, slopes.evaluated)
    rates = [np.gradient(seen, trace.time, axis=0)[..., None] for seen, trace in zip(observed, traces, strict=True)]
    rows = [trace.rows_at(trace.time) for trace in traces]
    columns = problem.whitened([bundle.to_lanes(rates, rows) for bundle in problem.bundles])[:, 0]
    residuals = np.clip(problem.residuals_of(slopes.evaluated.observed), -LARGEST, LARGEST)
    gains = []
    for index, trace in enumerate(traces):
        mine = problem.owner == index
        behind = np.repeat(_last_edge(trace, int(np.count_nonzero(mine)) // len(CHANNELS)), len(CHANNELS))
        along, sizes = (np.bincount(behind, columns[mine] * each[mine])[1:] for each in (residuals, columns))
        gains.append(along[sizes > 0] ** 2 / sizes[sizes > 0])
    found = np.concatenate(gains)
    return bool(np.sum(found) > len(found) + SHOWN * np.sqrt(2 * len(found)))


def _last_edge(trace: Trace, length: int) -> Int[np.ndarray, " samples"]:
    """How many edges there were before every sample of a trace, none behind its end."""
    edges = trace.edges()
    began = trace.channels["pwm"].time[edges] if len(edges) else trace.time[:0]
    return np.pad(np.searchsorted(began, trace.time, side="right"), (0, length - len(trace.time)))


@dataclasses.dataclass(frozen=True)
class FoundEdges:
    """What traces tell of the edges: by how many samples they are later than they are read, and the gain in chi^2."""

    late: Late
    gain: float

    @property
    def evident(self) -> bool:
        """Whether each edge brings what is evident, in the mean."""
        return self.gain > EVIDENT_EDGE * sum(map(len, self.late))

    @property
    def farthest(self) -> float:
        """Samples by which the edge is moved that is moved most."""
        return max(abs(value) for each in self.late for value in each)


def moved(late: Late, more: Late) -> Late:
    """Edges that are later by so much more."""
    return tuple(tuple(np.add(each, beyond).tolist()) for each, beyond in zip(late, more, strict=True))


def alike(late: Late) -> bool:
    """Whether the edges of every trace are as late as each other, so that they are a delay of the duty."""
    return all(float(np.std(each)) < DIFFER for each in late if each)


def possible(late: Late) -> bool:
    """Whether edges may be as late as that, each trace's all together."""
    return all(float(np.ptp(each)) < WIDEST for each in late if each)


def whole_samples(traces: Sequence[Trace], delay: float, late: Late) -> tuple[float, Late]:
    """What edges have in common beyond a part of a sample as a delay in s, and what is left of it as each edge's own.

    A record shows no edge before it was, so that the later ones are those that it has on time.
    """
    clocks = [sample_interval(trace) for trace in traces]
    found = np.concatenate([delay + clock * np.asarray(each) for clock, each in zip(clocks, late, strict=True)])
    whole = max(clocks) * round(float(np.quantile(found, ON_TIME)) / max(clocks))
    rest = tuple(((delay - whole) / clock,) * len(each) for clock, each in zip(clocks, late, strict=True))
    return whole, moved(late, rest)


def find_edges(problem: FitProblem, slopes: Slopes, late: Late, *, beyond_delays: bool = False) -> FoundEdges:
    """The linear problem of parameters and edges together, of a problem that knows what edges move.

    With `beyond_delays` the gain is what edges bring beyond a delay of each trace, its edges all as late as each other.
    """
    plain = problem.without_edges()
    point = Point.of(plain, slopes.at, slopes.evaluated, slopes)
    assert problem.responses is not None, "what edges move is not known"
    responses = plain.whitened(problem.responses)
    owner, counts = plain.owner, [len(each) for each in late]
    ends = np.cumsum([0, *counts])
    columns = np.zeros((len(point.residuals) + ends[-1], ends[-1]))
    delays = np.zeros((len(columns), len(late)))
    for trace, (begin, end) in enumerate(itertools.pairwise(ends)):
        mine = np.flatnonzero(owner == trace)
        columns[mine, begin:end] = responses[mine, : end - begin]
        delays[:, trace] = np.sum(columns[:, begin:end], axis=1)
    columns[len(point.residuals) :] = np.eye(ends[-1])  # known beforehand to a sample of its record
    padded = np.concatenate([point.columns, np.zeros((ends[-1], point.columns.shape[1]))])
    if beyond_delays:
        padded = np.column_stack([padded, delays])
    residuals = np.concatenate([point.residuals, *late])
    alone, _ = _solved(residuals, padded)
    together, values = _solved(residuals, np.column_stack([padded, columns]))
    moved = -values[padded.shape[1] :]
    found = tuple(tuple(moved[begin:end].tolist()) for begin, end in itertools.pairwise(ends))
    return FoundEdges(found, alone - together)


def _solved(residuals: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray]:
    """What is left of chi^2 by the best linear step, and the values that explain residuals."""
    few, reduced = reduce_rows(residuals, columns)
    lengths = np.linalg.norm(reduced, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    values = np.linalg.lstsq(reduced / lengths, few, rcond=1e-12)[0] / lengths
    left = few - reduced @ values
    return float(left @ left), values
