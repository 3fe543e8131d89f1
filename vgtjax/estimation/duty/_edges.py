"""Edges of a duty between the samples of its record.

A record that is slower than the duty shows an edge at the first sample after it: each edge was earlier, by another part
of a sample. What that moves is a column of the least squares for every edge, which is eliminated like the offset of a
sensor, with a sample as what is known of it beforehand.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float, Int

from ..._types import Coordinates
from ...traces import Trace
from .._least_squares import finite_columns, least_squares, reduce_rows
from .._task import Task
from ..derivatives import CHANNELS, Computation, Evaluated, Evaluation, ask, bundle_traces, side_by_side
from ..measurements import Edges, FitProblem, Late, by_trace, known_beforehand, read_duties, sample_interval
from ..search import SPREAD, Point, Slopes

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
LATEST = 0.35
"""Samples by which an edge may be late without a delay of the duty, as noise has it: 0.13 in a good fit. Searches
that took a late duty for a lighter plunger had 0.45 and 0.7, and values hundreds of standard errors off."""
EVIDENT_EDGE = 9.0
"""Gain in chi^2 that each edge must bring in the mean: three standard errors."""


def edges_of(
    task: Task, problem: FitProblem, late: Late, at: Float[np.ndarray, " coordinates"], *, delay: bool
) -> Computation[Edges]:
    """Edges that are so late, with what each moves: the column `j` of a lane is that of edge `j` of its trace.

    One simulation of all traces moves an edge in each of them. Where one fails, its edges are taken to move nothing.
    """
    asked, count = problem.evaluation(at), max(map(len, late))
    nudged = (late, *(_nudged(late, edge) for edge in range(count)))
    read = [read_duties(task.fit, task.linear, each, asked.delay or 0.0) for each in nudged]
    answers = yield from side_by_side([_seen(task, asked, each) for each in read], at_once=len(SPREAD))
    here, *there = ([np.asarray(seen) for seen in each] for each in answers)
    columns = [
        np.stack([_differences(each[index], base) for each in there], axis=-1) for index, base in enumerate(here)
    ]
    moving = [
        column.sum(axis=-1) * (trace.duty_late != 0) / sample_interval(trace)
        for column, trace in zip(columns, task.traces, strict=True)
    ]
    rows = [trace.rows_at(recorded.time) for trace, recorded in zip(task.traces, task.fit, strict=True)]
    responses, together = ([bundle.to_lanes(each, rows) for bundle in problem.bundles] for each in (columns, moving))
    return Edges(late, delay, responses, together, task.edges_delay)


def _seen(task: Task, asked: Evaluation, read: Sequence[Trace]) -> Computation[list[np.ndarray]]:
    """What is observed of traces with their edges somewhere else, at the times of their records."""
    bundles = bundle_traces(task.model, read, task.steps)
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


def possible(late: Late, *, delay: bool) -> bool:
    """Whether edges may be as late as that, each trace's all together; none beyond its record without a `delay`."""
    latest = max((value for each in late for value in each), default=0.0)
    return (delay or latest < LATEST) and all(float(np.ptp(each)) < WIDEST for each in late if each)


def whole_samples(traces: Sequence[Trace], delay: float, late: Late) -> tuple[float, Late]:
    """What edges have in common beyond a part of a sample as a delay in s, and what is left of it as each edge's own.

    A record shows no edge before it was, so that the later ones are those that it has on time.
    """
    clocks = [sample_interval(trace) for trace in traces]
    found = np.concatenate([delay + clock * np.asarray(each) for clock, each in zip(clocks, late, strict=True)])
    longest = max(clock for clock, each in zip(clocks, late, strict=True) if each)
    whole = longest * round(float(np.quantile(found, ON_TIME)) / longest)
    rest = tuple(((delay - whole) / clock,) * len(each) for clock, each in zip(clocks, late, strict=True))
    return whole, moved(late, rest)


def find_edges(
    problem: FitProblem,
    slopes: Slopes,
    here: tuple[Coordinates, Evaluated] | None = None,
    *,
    beyond_delays: bool = False,
) -> FoundEdges:
    """The linear problem of parameters and edges together, of a problem that knows what edges move.

    The gain is that of the traces, without what edges are away from what is known of them beforehand. With
    `beyond_delays` it is what edges bring beyond a delay of each trace, its edges all as late as each other.

    **Arguments:** `here`: coordinates and what is observed there, if the derivatives are from elsewhere.
    """
    plain, edges = problem.without_edges(), problem.edges
    assert edges is not None, "what edges move is not known"
    point = Point.of(plain, *((slopes.at, slopes.evaluated) if here is None else here), slopes)
    columns, parameters = finite_columns(_columns(plain, edges)), finite_columns(point.columns)
    columns = np.pad(columns, ((0, len(parameters) - len(columns)), (0, 0)))  # rows of what is known of parameters
    if beyond_delays:
        parameters = np.column_stack([parameters, _sums(columns, edges.late)])
    alone, _ = _solved(point.residuals, parameters)
    known = [known_beforehand(late, delay=edges.delay) for late in edges.late]
    residuals = np.concatenate([point.residuals, *(away for away, _ in known)])
    rows = scipy.linalg.block_diag(*(rows for _, rows in known))
    together = np.column_stack([np.pad(parameters, ((0, len(rows)), (0, 0))), np.concatenate([columns, rows])])
    _, values = _solved(residuals, together)
    left = (residuals - together @ values)[: len(point.residuals)]
    moved = np.split(-values[parameters.shape[1] :], np.cumsum([len(each) for each in edges.late])[:-1])
    return FoundEdges(tuple(tuple(each.tolist()) for each in moved), alone - float(left @ left))


def _columns(problem: FitProblem, edges: Edges) -> Float[np.ndarray, "residuals edges"]:
    """What every edge moves of residuals, the edges of one trace behind those of the one before."""
    responses, owner = problem.whitened(edges.responses), problem.owner
    return np.column_stack(
        [responses[:, : len(late)] * (owner == trace)[:, None] for trace, late in enumerate(edges.late)]
    )


def _sums(columns: np.ndarray, late: Late) -> Float[np.ndarray, "residuals traces"]:
    """What moves when all edges of a trace are later."""
    ends = np.cumsum([len(each) for each in late])[:-1]
    return np.column_stack([part.sum(axis=1) for part in np.split(columns, ends, axis=1)])


def _solved(residuals: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray]:
    """What is left of chi^2 by the best linear step, and the values that explain residuals."""
    few, reduced = reduce_rows(residuals, columns)
    values = least_squares(reduced, few).values
    left = few - reduced @ values
    return float(left @ left), values
