"""Whether a duty was held from sample to sample, as a record is read at first, or linear between them.

The mean over a sample of a duty that is linear between samples is that of a held one half a sample earlier. So a fit
with a free delay has both in it, and its delays by kind of trace tell which it was: no duty arrives early, and of what
is left the explanation counts that needs the smaller delay.
"""

import dataclasses
import itertools
import math
from collections.abc import Container, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...traces import Trace
from .._least_squares import estimate_uncertainty, reduce_rows

EVIDENT, SHARP = 3.0, 10.0
"""Standard errors by which a delay must differ from none to be one, and that half a sample must have for a delay of
none to tell a held duty from a linear one."""
PERCEPTIBLE = 25.0
"""Increase of chi^2 from which an explanation is evidently worse than another: five standard errors. With three, edges
of a duty that its record rounds to whole samples, half of one early in the mean, were taken for linear."""


@dataclasses.dataclass(frozen=True)
class Holds:
    """Sample intervals in s of the traces whose duty was linear between samples, the delay in s that is left then, and
    whether no explanation is left that reads the slowest traces otherwise, of which half a sample is the most."""

    linear: tuple[float, ...]
    delay: float
    decided: bool


def sample_interval(trace: Trace) -> float:
    """Usual time in s between samples of the duty of a trace, to a tenth of a millisecond, or two digits of less than
    one: the same for clocks that run a little differently."""
    duty = trace.channels.get("pwm")
    interval = float(np.median(np.diff(trace.time if duty is None else duty.time)))
    return round(interval, max(4, 1 - math.floor(math.log10(interval))))


def read_holds(
    residuals: Float[np.ndarray, " rows"],
    columns: Float[np.ndarray, "rows coordinates"],
    owner: Int[np.ndarray, " residuals"],
    traces: Sequence[Trace],
    delay: float,
    slope: float,
    count: int,
    linear: Sequence[float] = (),
    held: Container[float] = (),
) -> Holds:
    """How the duty of traces was held, by a fit that took it for `delay` s late, held but where it says `linear`.

    **Arguments:** `residuals` and `columns` at the end of the fit, the delay last, in units of `slope` s; `owner`: the
    trace of every row, behind which may be rows of what is known beforehand; `linear` and `held`: sample intervals in s
    of traces whose duty was read as linear between samples, and of those where it is known to be held.
    """
    intervals = np.array([sample_interval(trace) for trace in traces])
    kinds = np.unique(intervals)
    mine = np.zeros((len(columns), len(kinds)))
    mine[: len(owner)] = intervals[owner][:, None] == kinds
    late = columns[:, -1:] * mine
    found = estimate_uncertainty(*reduce_rows(residuals, np.column_stack([columns[:, :-1], late])), count)
    last = slice(columns.shape[1] - 1, None)
    if not np.all(found.estimable[last]):
        return Holds((), delay, False)
    delays = delay - slope * found.values[last] - np.where(np.isin(kinds, linear), kinds / 2, 0.0)
    return judge_holds(delays, slope**2 * found.covariance[last, last], kinds, held)


def judge_holds(
    delays: Float[np.ndarray, " kinds"],
    covariance: Float[np.ndarray, "kinds kinds"],
    intervals: Float[np.ndarray, " kinds"],
    held: Container[float] = (),
) -> Holds:
    """How duties were held that, all of them taken for held, arrive `delays` s late, by sample interval in s; those of
    some intervals are known to be `held`."""
    information = np.linalg.inv(covariance)
    weight = float(np.sum(information))
    explanations = []
    for linear in itertools.product(*((False,) if each in held else (False, True) for each in intervals)):
        late = delays + np.where(linear, intervals / 2, 0.0)
        common = float(np.sum(information @ late)) / weight
        misfit = float((late - common) @ information @ (late - common)) + weight * min(common, 0.0) ** 2
        explanations.append((misfit, Holds(tuple(intervals[list(linear)].tolist()), common, False)))
    best = min(misfit for misfit, _ in explanations)
    left = sorted((holds for misfit, holds in explanations if misfit <= best + PERCEPTIBLE), key=lambda h: abs(h.delay))
    # Where a delay is left even so, half a sample more of it may be another hold; a delay of none is the simplest.
    none = abs(left[0].delay) <= EVIDENT / np.sqrt(weight) and SHARP / np.sqrt(weight) < np.min(intervals) / 2
    slowest = float(np.max(intervals))
    alike = len({slowest in holds.linear for holds in left}) == 1
    decided = (alike or bool(none)) and best < PERCEPTIBLE + len(intervals)
    return dataclasses.replace(left[0], decided=decided)


def ramped(traces: Sequence[Trace], intervals: Sequence[float]) -> list[Trace]:
    """Traces, those that are sampled at such an interval with a duty that is linear between samples."""
    return [trace.with_ramped_duty() if sample_interval(trace) in intervals else trace for trace in traces]
