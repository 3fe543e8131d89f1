"""What a closed loop was worth: error, effort, observed pressure, and how it answered steps."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._types import Scalar
from ._loop import ClosedLoop

BAND = 1e-4
"""m; a step is answered once the rod stays so near: one part in a hundred of the stroke."""
AT_REST = 1e-12
"""m; a reference that moves by less from one sample to the next is at rest: rounding moves it by 1e-18 m."""

HELD = 10.0
"""m/s times the relative error of rounding: what is held is off by no more, a hundred times the rounding of 0.1 m/s."""


def tracking_rms(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square of reference minus true position in m."""
    return jnp.sqrt(_mean(jnp.square(run.error), run.time >= settled))


def tracking_peak(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Largest distance between reference and true position in m."""
    return jnp.max(jnp.where(run.time >= settled, jnp.abs(run.error), 0.0))


def pressure_rms(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square of true minus observed chamber pressure in Pa; NaN for a controller that observes none."""
    observed = run.observed("pressure")
    if observed is None:
        return jnp.asarray(jnp.nan, run.pressure.dtype)
    return jnp.sqrt(_mean(jnp.square(run.pressure - observed), run.time >= settled))


def pressure_peak(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Largest error of the observed chamber pressure in Pa; NaN for a controller that observes none."""
    observed = run.observed("pressure")
    if observed is None:
        return jnp.asarray(jnp.nan, run.pressure.dtype)
    return jnp.max(jnp.where(run.time >= settled, jnp.abs(run.pressure - observed), 0.0))


def sliding_share(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Share of samples at which a switching observer slides: its velocity is the one that it is given [5.16].

    NaN for a controller that observes no error of a velocity.
    """
    error = run.observed("velocity_error")
    if error is None:
        return jnp.asarray(jnp.nan, run.pressure.dtype)
    held = jnp.abs(error) < HELD * jnp.finfo(error.dtype).eps
    return _mean(jnp.where(held, 1.0, 0.0), run.time >= settled)


def effort(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square of the duty in percent."""
    return jnp.sqrt(_mean(jnp.square(run.duty), run.time >= settled))


def chatter(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square change of the duty from one sample to the next in percent."""
    return jnp.sqrt(_mean(jnp.square(jnp.diff(run.duty)), run.time[1:] >= settled))


def _mean(values: Array, counted: Bool[Array, " time"]) -> Scalar:
    return jnp.sum(jnp.where(counted, values, 0.0)) / jnp.maximum(jnp.sum(counted), 1)


@dataclasses.dataclass(frozen=True)
class StepAnswer:
    """How the rod answered one step of a reference: from when it begins to when the next one does.

    `begin` in s, `height` in m. `settling_time` in s counts from `begin` to when the rod comes within [`BAND`][] of
    the level for good; infinite where it does not. `overshoot` is how far it went beyond the level in m.
    """

    begin: float
    height: float
    settling_time: float
    overshoot: float


def step_answers(
    time: Float[np.ndarray, " time"],
    reference: Float[np.ndarray, " time"],
    position: Float[np.ndarray, " time"],
    hold: float = 0.1,
) -> list[StepAnswer]:
    """The answers of a rod to every step of a reference that ends at rest; none for a reference that never rests.

    **Arguments:** `time` in s; `reference`, `position` in m; `hold`: s for which a reference rests after a step.
    """
    moves = np.concatenate([[False], np.abs(np.diff(reference)) > AT_REST, [False]])
    begins, ends = np.flatnonzero(moves[1:] & ~moves[:-1]), np.flatnonzero(moves[:-1] & ~moves[1:])
    stops = [*begins[1:].tolist(), len(time) - 1]
    answers = []
    for begin, end, stop in zip(begins.tolist(), ends.tolist(), stops, strict=True):
        if time[stop] - time[end] >= hold:
            answers.append(
                _answer(time[begin : stop + 1], reference[begin], reference[end], position[begin : stop + 1])
            )
    return answers


def _answer(
    time: Float[np.ndarray, " time"], before: float, level: float, position: Float[np.ndarray, " time"]
) -> StepAnswer:
    beyond = (position - level) * np.sign(level - before)
    outside = np.flatnonzero(np.abs(beyond) > BAND)
    last = int(outside[-1]) if len(outside) else -1
    settling = float(time[last + 1] - time[0]) if last + 1 < len(time) else np.inf
    return StepAnswer(float(time[0]), float(level - before), settling, float(max(np.max(beyond), 0.0)))
