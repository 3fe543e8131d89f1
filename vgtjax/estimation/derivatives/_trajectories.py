"""Traces simulated from their first sample to their last, which the parallel Jacobian then cuts into segments.

One after the other, as far as each goes: a vector of traces waits for the longest of them, and a step of five side by
side takes four times as long as that of one.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...plants import AbstractModel, State, tabulated_along
from ...simulation import RESULTS, AbstractFixedMarch, choose, end_of
from ._bundle import Bundle
from ._layout import SEGMENT

Lanes = Float[Array, "lanes sample channel"]
Segments = Int[np.ndarray, " traces"] | Int[Array, " traces"]


def trajectories(model: AbstractModel, bundle: Bundle, segments: Segments) -> tuple[State, Lanes, RESULTS]:
    """States at the start of every lane, what is observed along it, and how the simulation of each trace ended.

    **Arguments:** `segments` that each trace is simulated for, at least those that it fills.
    """
    model = tabulated_along(model, bundle.drive)
    drive = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0).reshape(leaf.shape[-1], -1, SEGMENT), bundle.drive)

    def one(given: tuple[Any, Any, Array]) -> Any:
        return _march(model, bundle.plan, *given)

    first, observed, ended = jax.lax.map(one, (drive, bundle.start, jnp.asarray(segments)))
    first, seen = jax.tree.map(lambda leaf: leaf[bundle.lane_trace, bundle.lane_segment], (first, observed))
    return first, seen, ended


def _march(
    model: AbstractModel, plan: AbstractFixedMarch, drive: Any, start: Any, count: Array
) -> tuple[State, Float[Array, "segments sample channel"], RESULTS]:
    """So many segments of a trace, whose inputs have leaves `(segments, sample)`."""
    begin = model.start(start, jax.tree.map(lambda leaf: leaf[0, 0], drive))

    def interval(carry: Any, inputs: Any) -> tuple[Any, Array]:
        state, solved = carry
        onward, found = plan.advance(model, state, inputs)
        return (onward, solved & found), jnp.stack(model.observe(state, inputs))

    def segment(number: Array, carry: Any) -> Any:
        state, first, observed = carry
        inputs = jax.tree.map(lambda leaf: jax.lax.dynamic_index_in_dim(leaf, number, 0, keepdims=False), drive)
        onward, seen = jax.lax.scan(interval, state, inputs)
        first, observed = jax.tree.map(
            lambda all_, each: jax.lax.dynamic_update_index_in_dim(all_, each, number, 0),
            (first, observed),
            (state[0], seen),
        )
        return onward, first, observed

    seen = jax.eval_shape(lambda: jnp.stack(model.observe(begin, jax.tree.map(lambda leaf: leaf[0, 0], drive))))
    first = jax.tree.map(lambda leaf: jnp.zeros((len(drive.duration), *leaf.shape), leaf.dtype), begin)
    observed = jnp.zeros((*drive.duration.shape, *seen.shape), seen.dtype)
    nothing = ((begin, jnp.asarray(True)), first, observed)
    (last, solved), first, observed = jax.lax.fori_loop(0, count, segment, nothing)
    # What has left the finite numbers never comes back to them.
    ended = end_of((first, last), choose(solved, RESULTS.successful, RESULTS.root_not_found), model)
    return first, observed, ended
