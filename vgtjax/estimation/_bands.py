"""How well the parameters' errors leave a simulated trace known."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ..plants import AbstractModel
from ._bundle import CHANNELS, Bundle, bundle_traces
from ._evaluation import Evaluated, Evaluation, Steps, ask
from ._evidence import by_trace
from ._holds import ramped
from ._task import Task

Bands = list[Float[np.ndarray, "time channel"]]


def spread_of(bundles: Sequence[Bundle], slopes: Evaluated, covariance: Float[np.ndarray, "units units"]) -> Bands:
    """Standard errors of what is observed of every trace, in m and Pa, to first order.

    **Arguments:** `slopes` with respect to the same quantities as the covariance.
    """
    sizes, ways = np.linalg.eigh(covariance)
    factor = ways * np.sqrt(np.maximum(sizes, 0.0))
    errors = [np.sqrt(np.sum(np.square(columns @ factor), axis=-1)) for columns in slopes.columns]
    return by_trace(bundles, Evaluated(errors, []))


def predicted_spread(
    task: Task,
    model: AbstractModel,
    delay: float,
    fitted: tuple[Sequence[Bundle], Evaluated],
    covariance: Float[np.ndarray, "units units"],
) -> Steps[Bands]:
    """`spread_of` all traces of a task, those to fit first; NaN where a simulation fails.

    **Arguments:** `fitted`: bundles of the traces to fit, and their slopes; those of the others are asked for.
    """
    others = ramped(task.validate, task.linear)
    nothing = [np.full((len(trace.time), len(CHANNELS)), np.nan) for trace in (*task.fit, *others)]
    if not np.all(np.isfinite(covariance)):
        return nothing
    found, missing = spread_of(*fitted, covariance), nothing[len(task.fit) :]
    if not others:
        return found
    bundles = bundle_traces(model, others, task.stepping)
    try:
        slopes = yield from ask(Evaluation(model, bundles, delay if task.late_duty else None, task.selection))
    except SimulationError:
        return [*found, *missing]
    return [*found, *(missing if slopes.failed else spread_of(bundles, slopes, covariance))]
