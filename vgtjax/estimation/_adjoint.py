"""Derivatives of simulated traces in reverse mode, which forward mode is checked against.

The discrete adjoint: the trajectory is run once, then a cotangent of what is observed is pulled back through every
interval, from the last to the first. It shares nothing with the segment-parallel Jacobian but the model and its steps.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar
from ..parameters import Selection
from ..parts import tables_of, with_tables
from ..plants import AbstractModel, State, rows_along, tabulated_along
from ..simulation import march
from ._bundle import SEGMENT, Bundle

Cotangent = Float[Array, "lanes sample channel"]
Gradient = Float[Array, " parameters"]


def pull_back(
    model: AbstractModel, selection: Selection, bundle: Bundle, delay: Scalar | None, cotangent: Cotangent
) -> Gradient:
    """Derivatives of `sum(cotangent * observe(model, bundle, delay))` with respect to the selected parameters in the
    units of the table; with a `delay` in s of the duty, that with respect to it comes last."""
    late = bundle if delay is None else bundle.with_late_duty(delay)[0]
    ready = tabulated_along(model, late.drive)
    states = jax.vmap(lambda drive, start: march(ready, drive, start, bundle.plan)[0], (1, 0), 1)(
        late.drive, late.start
    )
    adjoint, gradient, duty = _backwards(model, selection, late, states, _by_time(late, cotangent))
    gradient = gradient + _through_start(model, selection, late, adjoint)
    if delay is None:
        return gradient
    _, back = jax.vjp(lambda delay: bundle.with_late_duty(delay)[0].drive.pwm, delay)
    return jnp.append(gradient, back(duty)[0])


def _by_time(bundle: Bundle, cotangent: Cotangent) -> Float[Array, "time channel traces"]:
    """A cotangent in the layout of the drive; that of lanes which only fill up a device is zero."""
    time, traces = bundle.drive.duration.shape
    table = jnp.zeros((time // SEGMENT, SEGMENT, traces, cotangent.shape[-1]), cotangent.dtype)
    table = table.at[bundle.lane_segment, :, bundle.lane_trace].add(cotangent)
    return jnp.swapaxes(table.reshape(time, traces, -1), 1, 2)


def _backwards(
    model: AbstractModel, selection: Selection, bundle: Bundle, states: State, wanted: Array
) -> tuple[State, Gradient, Float[Array, "time traces"] | None]:
    """Cotangents of the start states, of the parameters by what happens in all intervals, and of the duty of each."""
    theta = selection.pack(model)
    # Tables are made once, not in every interval.
    rows = rows_along(model, bundle.drive)
    tables, through_tables = jax.vjp(lambda theta: tables_of(selection.unpack(model, theta), rows), theta)

    def interval(carry: tuple[State, Any], inputs: tuple[State, Any, Array]) -> tuple[tuple[State, Any], Any]:
        adjoint, gradient = carry
        state, drive, wanted = inputs

        def onward(values: Any, state: State, duty: Array | None) -> tuple[State, Array]:
            chosen = with_tables(selection.unpack(model, values[0]), values[1])
            given = eqx.tree_at(lambda drive: drive.pwm, drive, duty, is_leaf=lambda leaf: leaf is None)
            after = jax.vmap(lambda y, u: bundle.plan.advance(chosen, y, u)[0])(state, given)
            return after, jnp.stack(jax.vmap(chosen.observe)(state, given))

        _, back = jax.vjp(onward, (theta, tables), state, drive.pwm)
        by_values, adjoint, by_duty = back((adjoint, wanted))
        return (adjoint, jax.tree.map(jnp.add, gradient, by_values)), by_duty

    nothing = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[0]), states)
    carry = (nothing, jax.tree.map(jnp.zeros_like, (theta, tables)))
    (adjoint, gradient), duty = jax.lax.scan(interval, carry, (states, bundle.drive, wanted), reverse=True)
    return adjoint, gradient[0] + through_tables(gradient[1])[0], duty


def _through_start(model: AbstractModel, selection: Selection, bundle: Bundle, adjoint: State) -> Gradient:
    """What the start states add, which depend on the parameters."""
    begin = jax.tree.map(lambda leaf: leaf[0], bundle.drive)

    def start(theta: Array) -> State:
        chosen = tabulated_along(selection.unpack(model, theta), begin)
        return jax.vmap(chosen.start)(bundle.start, begin)

    _, back = jax.vjp(start, selection.pack(model))
    return back(adjoint)[0]
