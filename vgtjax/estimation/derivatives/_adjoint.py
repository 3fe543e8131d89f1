"""Derivatives of simulated traces in reverse mode, which forward mode is checked against.

The discrete adjoint: the trajectory is run once, then a cotangent of what is observed is pulled back through every
interval, from the last to the first. It shares nothing with the segment-parallel Jacobian but the model, its steps, and
how tables of the model's parts move with the parameters.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar
from ...parameters import Selection
from ...parts import with_tables
from ...plants import AbstractModel, State
from ...simulation import march
from ._bundle import Bundle
from ._layout import SEGMENT
from ._values import Choose, Gradient, Pushed, chooser, pull_values

Cotangent = Float[Array, "lanes sample channel"]


def pull_back(
    model: AbstractModel,
    selection: Selection,
    bundle: Bundle,
    delay: Scalar | None,
    cotangent: Cotangent,
    pushed: Pushed,
) -> Gradient:
    """Derivatives of `sum(cotangent * observe(model, bundle, delay))` with respect to the selected parameters in the
    units of the table; with a `delay` in s of the duty, that with respect to it comes last.

    **Arguments:** `pushed`: the parameters and the model's tables, with a tangent of both for each parameter.
    """
    (values, tangents), choose = pushed, chooser(model, selection)
    late = bundle if delay is None else bundle.with_late_duty(delay)[0]
    ready = with_tables(model, values[1])
    states = jax.vmap(lambda drive, start: march(ready, drive, start, bundle.plan.forward())[0], (1, 0), 1)(
        late.drive, late.start
    )
    adjoint, by_values, duty = _backwards(choose, values, late, states, _by_time(late, cotangent))
    by_values = jax.tree.map(jnp.add, by_values, _through_start(choose, values, late, adjoint))
    gradient = pull_values(tangents, by_values)
    if delay is None:
        return gradient
    slope = bundle.late_duty(delay)[-1]
    return jnp.append(gradient, sum(jax.tree.leaves(jax.tree.map(lambda d, s: jnp.sum(d * s), duty, slope))))


def _by_time(bundle: Bundle, cotangent: Cotangent) -> Float[Array, "time channel traces"]:
    """A cotangent in the layout of the drive; that of lanes which only fill up a device is zero."""
    time, traces = bundle.drive.duration.shape
    table = jnp.zeros((time // SEGMENT, SEGMENT, traces, cotangent.shape[-1]), cotangent.dtype)
    table = table.at[bundle.lane_segment, :, bundle.lane_trace].add(cotangent)
    return jnp.swapaxes(table.reshape(time, traces, -1), 1, 2)


def _backwards(
    choose: Choose, values: Any, bundle: Bundle, states: State, wanted: Array
) -> tuple[State, Any, tuple[Float[Array, "time traces"] | None, ...]]:
    """Cotangents of the start states, of values by what happens in all intervals, and of what a delay moves of each."""

    def interval(carry: tuple[State, Any], inputs: tuple[State, Any, Array]) -> tuple[tuple[State, Any], Any]:
        adjoint, gradient = carry
        state, drive, wanted = inputs

        def onward(values: Any, state: State, duty: Any) -> tuple[State, Array]:
            chosen, given = choose(values), drive.with_duty(duty)
            after = jax.vmap(lambda y, u: bundle.plan.advance(chosen, y, u)[0])(state, given)
            return after, jnp.stack(jax.vmap(chosen.observe)(state, given))

        _, back = jax.vjp(onward, values, state, drive.duty)
        by_values, adjoint, by_duty = back((adjoint, wanted))
        return (adjoint, jax.tree.map(jnp.add, gradient, by_values)), by_duty

    nothing = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[0]), states)
    carry = (nothing, jax.tree.map(jnp.zeros_like, values))
    (adjoint, gradient), duty = jax.lax.scan(interval, carry, (states, bundle.drive, wanted), reverse=True)
    return adjoint, gradient, duty


def _through_start(choose: Choose, values: Any, bundle: Bundle, adjoint: State) -> Any:
    """What the start states add, which depend on the values."""
    begin = jax.tree.map(lambda leaf: leaf[0], bundle.drive)
    _, back = jax.vjp(lambda values: jax.vmap(choose(values).start)(bundle.start, begin), values)
    return back(adjoint)[0]
