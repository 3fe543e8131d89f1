"""Traces simulated from their first sample to their last, which the parallel Jacobian then cuts into segments.

Each device takes one trace after the other, as far as that goes: a vector of traces waits for the longest of them, and
a step of five side by side takes four times as long as that of one.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..plants import AbstractModel, State, tabulated_along
from ..simulation import RESULTS, AbstractFixedMarch, choose, judge
from ._bundle import Bundle
from ._layout import SEGMENT

Lanes = Float[Array, "lanes sample channel"]
Segments = Int[np.ndarray, " traces"] | Int[Array, " traces"]


def trajectories(
    model: AbstractModel, bundle: Bundle, segments: Segments, place: Callable[[Any], Any], wide: int
) -> tuple[State, Lanes, RESULTS]:
    """States at the start of every lane, what is observed along it, and how the simulation of each trace ended.

    **Arguments:** `segments` that each trace is simulated for, at least those that it fills; `wide` traces are at the
    same time, on the devices where `place` spreads them.
    """
    model, traces = tabulated_along(model, bundle.drive), bundle.start.at_rest.shape[0]
    rounds = -(-traces // wide)
    filled = rounds * wide - traces

    def by_round(leaf: Array) -> Array:
        padded = jnp.pad(leaf, [(0, 0)] * (leaf.ndim - 1) + [(0, filled)], mode="edge")
        return jnp.moveaxis(padded.reshape(*leaf.shape[:-1], rounds, wide), -2, 0)

    drive, start = jax.tree.map(by_round, (bundle.drive, bundle.start))
    drive = jax.tree.map(lambda leaf: leaf.reshape(rounds, -1, SEGMENT, wide), drive)
    count = jnp.max(jnp.pad(jnp.asarray(segments), (0, filled)).reshape(rounds, wide), axis=1)

    def one_round(given: tuple[Any, Any, Array]) -> Any:
        drive, start, count = given
        return _march(model, bundle.plan, place(drive), place(start), count, place)

    first, observed, ended = jax.lax.map(one_round, (drive, start, count))

    def by_trace(leaf: Array) -> Array:
        return jnp.moveaxis(leaf, 0, -2).reshape(*leaf.shape[1:-1], -1)

    first = jax.tree.map(lambda leaf: by_trace(leaf)[bundle.lane_segment, bundle.lane_trace], first)
    seen = by_trace(observed)[bundle.lane_segment, :, :, bundle.lane_trace]
    return first, seen, jax.tree.map(lambda leaf: leaf.reshape(-1)[:traces], ended)


def _march(
    model: AbstractModel, plan: AbstractFixedMarch, drive: Any, start: Any, count: Array, place: Callable[[Any], Any]
) -> tuple[State, Float[Array, "segments sample channel traces"], RESULTS]:
    """So many segments of a few traces, whose inputs have leaves `(segments, sample, traces)`."""
    segments, _, traces = drive.duration.shape
    begin = jax.vmap(model.start)(start, jax.tree.map(lambda leaf: leaf[0, 0], drive))

    def interval(carry: Any, inputs: Any) -> tuple[Any, Array]:
        state, solved = carry
        onward, found = jax.vmap(lambda y, u: plan.advance(model, y, u))(state, inputs)
        return (onward, solved & found), jnp.stack(jax.vmap(model.observe)(state, inputs))

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

    seen = jax.eval_shape(lambda: jax.vmap(model.observe)(begin, jax.tree.map(lambda leaf: leaf[0, 0], drive)))
    first = jax.tree.map(lambda leaf: jnp.zeros((segments, *leaf.shape), leaf.dtype), begin)
    observed = jnp.zeros((segments, SEGMENT, len(seen), traces), seen[0].dtype)
    nothing = place(((begin, jnp.ones(traces, bool)), first, observed))
    (last, solved), first, observed = jax.lax.fori_loop(0, count, segment, nothing)

    def ended(first: State, last: State, solved: Array) -> RESULTS:
        # What has left the finite numbers never comes back to them.
        return judge((first, last), choose(solved, RESULTS.successful, RESULTS.root_not_found), model)

    return first, observed, jax.vmap(ended, in_axes=(-1, -1, 0))(first, last, solved)
