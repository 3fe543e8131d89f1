"""Flow that changes in time: passages between a plenum and an outlet whose pressures move, and shock tubes."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError, is_traced, require_finite, require_positive
from .._types import Values
from ._balance import Ends, balance_of
from ._gas import Gas
from ._passage import Inlet, Passage
from ._riemann import States, pack
from ._steady import PassageFlow, as_plain_arrays, flow_of
from ._steppers import AbstractStepper, Explicit, Implicit

State = tuple[Values, Values, Values, Values]
"""Density in kg/m3, meridional and circumferential velocity in m/s, pressure in Pa, one value per cell."""
STATE = {
    "density": (require_positive, "density in kg/m3"),
    "v_m": (require_finite, "velocity in m/s"),
    "v_u": (require_finite, "velocity in m/s"),
    "pressure": (require_positive, "pressure in Pa absolute"),
}
"""What each must be."""


def unsteady(
    passage: Passage,
    inlet: Inlet | None,
    outlet_pressure: Values | None,
    state: State,
    times: Float[Array | np.ndarray, " times"],
    gas: Gas,
    *,
    stepper: AbstractStepper | None = None,
) -> PassageFlow:
    """Flow through a passage at given times, from a state at the first of them; `steady` is where it ends.

    Differentiable in both modes. Where `converged` is false, nothing later means anything.

    **Arguments:**

    - `inlet`: without one both ends are open: waves leave, and none comes in, as in a shock tube; there is no outlet
      then, and `outlet_pressure` is not read.
    - `outlet_pressure`: in Pa absolute. It, and each quantity of the inlet, is one number, or one a time, linear
      between the times. Without one the outlet is open.
    - `state`: density, meridional and circumferential velocity, and pressure of each cell.
    - `times`: in s, increasing; an implicit stepper takes one step from each to the next.
    - `stepper`: [`Implicit`][] between a plenum and an outlet, and [`Explicit`][] with both ends open, unless given.

    **Returns:** the flow with a leading axis of times.

    **Raises:** `InputError` for times that don't increase, an outlet pressure that is not positive, or a state that is
    not one value per cell, with positive densities and pressures and finite velocities.
    """
    state, times = _checked(passage, state, times)
    if outlet_pressure is not None:
        require_positive("outlet_pressure", outlet_pressure, "pressure in Pa absolute", "correct it")
    ends = _over(times, Ends(None, None) if inlet is None else Ends(inlet, outlet_pressure))
    if stepper is None:
        stepper = Explicit() if inlet is None else Implicit()
    return _march(*as_plain_arrays((passage, ends, state, times, gas, stepper)))


@eqx.filter_jit
def _march(
    passage: Passage, ends: Ends, state: State, times: Values, gas: Gas, stepper: AbstractStepper
) -> PassageFlow:
    """One program for all passages of as many cells and as many times."""
    density, velocity, swirling, pressure = state
    start = pack(density, velocity, swirling * passage.centre_radius, pressure)
    first = jax.tree.map(lambda leaf: leaf[0], ends)
    balance = balance_of(passage, first, gas, *_usual(first, gas, density, pressure))

    def onward(carry: tuple[States, Array], interval: Any) -> tuple[Any, Any]:
        (states, fine), (begin, end, duration) = carry, interval
        # After a step that was not found no other is looked for.
        carry = jax.lax.cond(
            fine, lambda: stepper(balance, begin, end, states, duration), lambda: (states, jnp.zeros_like(fine))
        )
        return carry, carry

    before, after = (jax.tree.map(lambda leaf, part=part: leaf[part], ends) for part in (slice(-1), slice(1, None)))
    yes = jnp.ones((), bool)
    _, (later, found) = jax.lax.scan(onward, (start, yes), (before, after, jnp.diff(times)))
    states, converged = jnp.concatenate([start[None], later]), jnp.concatenate([yes[None], found])
    return jax.vmap(lambda ends, *rest: flow_of(balance.between(ends), *rest))(ends, states, converged)


def _usual(ends: Ends, gas: Gas, density: Values, pressure: Values) -> tuple[Values, Values]:
    """Density in kg/m3 and speed of sound in m/s that are usual: in the plenum, or else the largest at the start."""
    if ends.inlet is None:
        return jnp.max(density), jnp.max(jnp.sqrt(gas.gamma * pressure / density))
    return ends.inlet.density(gas), gas.sound_speed(ends.inlet.total_temperature)


def _over(times: Values, ends: Ends) -> Ends:
    """The ends with one value of everything a time."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, times.shape), ends)


def _checked(passage: Passage, state: State, times: Values) -> tuple[State, Values]:
    """Arrays of one kind.

    **Raises:** as `unsteady`.
    """
    times = jnp.asarray(times, jnp.result_type(float, *state))
    if not is_traced(times) and (
        times.ndim != 1 or times.size < 2 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0)
    ):
        raise InputError(f"times must be two or more that increase, in s, but they are {times}; correct them", "times")
    for (name, (require, what)), values in zip(STATE.items(), state, strict=True):
        if np.shape(values) != (passage.cells,):
            raise InputError(
                f"a state must be density, v_m, v_u and pressure with one value for each of {passage.cells} cells, but "
                f"the shape of its {name} is {np.shape(values)}; correct it",
                "state",
            )
        require(f"{name} of a state", values, what, "correct it")
    density, velocity, swirling, pressure = (jnp.asarray(values, times.dtype) for values in state)
    return (density, velocity, swirling, pressure), times
