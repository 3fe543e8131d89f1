"""What traces tell of the duty where a search stands: whether it is late, and how it was held between samples."""

import dataclasses

import numpy as np

from .._task import Task
from ..derivatives import CHANNELS, Computation
from ..measurements import (
    EVIDENT,
    FitProblem,
    Holds,
    by_trace,
    learn_sensors,
    left_over_noise,
    read_holds,
    sample_interval,
)
from ..search import LevenbergMarquardt, Point, meets_noise, most_left, transform_of


def delay_told(task: Task, search: LevenbergMarquardt) -> Computation[float | None]:
    """The coordinate of the delay that traces tell of where a search ended that took the duty for timely; `None` where
    they tell of none."""
    found = (yield from _with_delay(task, search)).uncertainty(search.problem.count)
    evident = bool(found.estimable[-1] and abs(found.values[-1]) > EVIDENT * found.std_errors[-1])
    return float(search.progress.coordinates[-1] - found.values[-1]) if evident else None


def _leaves_noise(task: Task, search: LevenbergMarquardt) -> bool:
    """Whether a search ended where the traces leave no more than noise, whatever outliers and filters of sensors they
    have, of which no search knows before its corrections: without outliers, and as `noise_to_meet` has it."""
    observed = by_trace(search.problem.bundles, search.slopes.evaluated)
    sensors = learn_sensors(task.traces, task.channels, observed, observed, task.unknown)
    squares, count = 0.0, 0
    for trace, seen, known in zip(task.traces, observed, sensors, strict=True):
        for channel, sensor in known.items():
            measured = trace.sampled(channel)
            assert measured is not None, "what a sensor has learned from was measured"
            left = sensor.values - seen[trace.rows(channel), CHANNELS.index(channel)]
            mine = int(np.count_nonzero(sensor.trust))
            squares += mine * left_over_noise(sensor, measured, channel, left) ** 2
            count += mine
    return bool(squares <= most_left(search) * count)


def leaves_only_noise(task: Task, search: LevenbergMarquardt) -> bool:
    """Whether a search ended where nothing is left that another reading of the duty could explain: noise, or outliers
    and filtered noise."""
    return meets_noise(search) or _leaves_noise(task, search)


def holds_of_duty(task: Task, search: LevenbergMarquardt) -> Computation[Holds | None]:
    """How duties were held by what the traces tell where a search ended; `None` where that is not to be asked."""
    progress, problem = search.progress, search.problem
    if not (task.unknown.duty_hold and progress.converged and progress.hold_decided is None) or progress.lost:
        return None
    scale, freedom = float(problem.transform.scale[-1]), problem.count - problem.offsets
    delay = scale * progress.coordinates[-1]
    # What a wrong model leaves over looks like a late duty, too.
    if not leaves_only_noise(task, search):
        return Holds((), delay, False)
    point = yield from _with_delay(task, search)
    holds = read_holds(point.residuals, point.columns, problem.owner, task.fit, delay, scale, freedom, task.linear)
    # No delay, and yet not held: neither is evident, but of traces beside others whose edges are on time.
    beside = bool(_held(task)) and not set(holds.linear) & set(_held(task))
    return holds if progress.late or beside or not holds.linear else Holds((), delay, False)


def holds_beside_edges(task: Task, search: LevenbergMarquardt, knowing: FitProblem) -> Computation[Holds]:
    """How duties were held by what traces without edges tell, whatever the times of the edges of the others.

    **Arguments:** `knowing`: the problem of the search, knowing what edges move.
    """
    scale, delay = float(search.problem.transform.scale[-1]), float(search.progress.coordinates[-1])
    held = _held(task)
    point, freedom = (yield from _with_delay(task, search, knowing)), knowing.count - knowing.offsets
    return read_holds(
        point.residuals, point.columns, knowing.owner, task.fit, scale * delay, scale, freedom, task.linear, held
    )


def may_be_linear(task: Task) -> bool:
    """Whether some traces are sampled as no trace with edges is, whose duty is known to be held."""
    return not {sample_interval(trace) for trace in task.fit} <= set(_held(task))


def _held(task: Task) -> list[float]:
    """Sample intervals in s of the traces with edges."""
    return [sample_interval(trace) for trace in task.fit if len(trace.edges())]


def _with_delay(task: Task, search: LevenbergMarquardt, problem: FitProblem | None = None) -> Computation[Point]:
    """The linear problem where a search stands, with the delay of the duty free; by default that of the search."""
    here = np.asarray(search.progress.coordinates)
    transform = transform_of(task, dataclasses.replace(search.progress, late=True))
    problem = dataclasses.replace(search.problem if problem is None else problem, transform=transform)
    slopes = search.slopes if search.problem.delay_is_free else (yield from search.slopes.with_delay(problem))
    return Point.of(problem, here, search.slopes.evaluated, slopes)
