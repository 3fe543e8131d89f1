"""How well the parameters' errors leave a simulated trace known."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..._errors import SimulationError
from .._least_squares import root_of
from .._task import Task
from ..derivatives import CHANNELS, Bundle, Computation, Evaluated, bundle_traces
from ..measurements import FitProblem, by_trace, ramped
from ..search import Slopes

Bands = list[np.ndarray]
"""By trace, `(time, channel)`."""


def spread_of(
    bundles: Sequence[Bundle], columns: Sequence[np.ndarray], covariance: Float[np.ndarray, "units units"]
) -> Bands:
    """Standard errors of what is observed of every trace, in m and Pa, to first order.

    **Arguments:** `columns` are derivatives with respect to the same quantities as the covariance.
    """
    errors = [spread_along(each, covariance) for each in columns]
    return by_trace(bundles, Evaluated(errors, []))


def spread_along(
    columns: Float[np.ndarray, "*samples units"], covariance: Float[np.ndarray, "units units"]
) -> Float[np.ndarray, "*samples"]:
    """Standard errors of what has these derivatives, whatever the units."""
    factor = root_of(covariance)
    with np.errstate(over="ignore", invalid="ignore"):  # of a value that ran away
        return np.sqrt(np.sum(np.square(columns @ factor), axis=-1))


def predicted_spread(
    task: Task, problem: FitProblem, slopes: Slopes, covariance: Float[np.ndarray, "units units"]
) -> Computation[Bands]:
    """`spread_of` all traces of a task, those to fit first; NaN where a simulation fails.

    **Arguments:** `slopes`: the derivatives along the traces to fit; those of the others are asked for, of the same
    places.
    """
    others = ramped(task.validate, task.linear)
    nothing = [np.full((len(trace.time), len(CHANNELS)), np.nan) for trace in (*task.traces, *others)]
    if not np.all(np.isfinite(covariance)):
        return nothing
    found, missing = spread_of(problem.bundles, slopes.columns, covariance), nothing[len(task.fit) :]
    if not others:
        return found
    bundles = bundle_traces(task.model, others, task.steps, problem.bundles)
    try:
        beyond = yield from slopes.along(problem, bundles)
    except SimulationError:
        return [*found, *missing]
    return [*found, *(missing if beyond.failed else spread_of(bundles, beyond.columns, covariance))]
