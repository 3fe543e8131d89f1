"""LuGre friction at a given velocity and its derivatives with respect to the six parameters [4.6-4.8]."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Scalar, Values
from ..parameters import parameter_table
from ..parts import Bristle, Contact, LuGre, Vanes

SMALL = 1e-6
"""Relaxation times `x = rate * time` below which `(1 - e^(-x)) / x` is `1 - x/2`, off by less than `x^2 / 6`."""


def steady_force(friction: LuGre, velocity: Values) -> Values:
    """Friction in N that has slid at a constant velocity in m/s for long, `g(v) sign(v) + sigma_2 v` [4.6, 4.7].

    The bristles have settled at `z = g(v) sign(v) / sigma_0`: neither `sigma_0` nor `sigma_1` acts. Zero at rest, where
    friction is whatever holds the rod.
    """
    return friction.steady_force(_contact(jnp.asarray(velocity)))


def starting_force(friction: LuGre, velocity: Scalar, time: Values) -> Values:
    """Friction in N after a start with relaxed bristles at a velocity in m/s that is constant from then on [4.6].

    At a constant velocity `z' = v - rate z` is linear with `rate = sigma_0 |v| / g(v)`: `z = v/rate (1 - e^(-rate t))`.
    It begins at `(sigma_1 + sigma_2) v` and ends at [`steady_force`][].

    **Arguments:** `time` since the start in s, zero or more.
    """
    contact = _contact(jnp.asarray(velocity))
    deflection = _bristle_after(friction, contact, friction.initial_state().deflection, time)
    return friction(contact, Bristle(deflection), jnp.zeros(()))[0]


def force_along(friction: LuGre, time: Values, velocity: Values) -> Float[Array, " time"]:
    """Friction in N along a prescribed velocity in m/s, from relaxed bristles [4.6].

    Between two samples the bristles move as at the mean of both velocities, exactly: second order in the interval, and
    stable however stiff they are.

    **Arguments:** `time` in s, rising.

    **Raises:** `InputError` when `time` and `velocity` differ in shape.
    """
    if jnp.shape(time) != jnp.shape(velocity) or jnp.ndim(time) != 1:
        raise InputError(
            f"time and velocity must have the same shape (time,), but theirs are {jnp.shape(time)} and "
            f"{jnp.shape(velocity)}; give one velocity per sample"
        )
    means, intervals = (velocity[1:] + velocity[:-1]) / 2, jnp.diff(time)

    def march(deflection: Scalar, step: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        mean, interval = step
        after = _bristle_after(friction, _contact(mean), deflection, interval)
        return after, after

    first = friction.initial_state().deflection
    _, later = jax.lax.scan(march, first, (means, intervals))
    deflection = jnp.concatenate([first[None], later])
    return friction(_contact(velocity), Bristle(deflection), jnp.zeros(()))[0]


def parameter_slopes(force: Callable[[LuGre], Array], friction: LuGre) -> dict[str, Array]:
    """Exact derivatives of a force with respect to each of the six parameters, in N per unit of the parameter.

    **Arguments:** `force`: of the friction alone, for instance `lambda member: steady_force(member, velocity)`.

    **Returns:** by name of the parameter, each with the shape of the force.
    """
    slopes = jax.jacfwd(force)(friction)
    return {name: getattr(slopes, name) for name in parameter_table(friction)}


def _contact(velocity: Values) -> Contact:
    """Mass and vanes play no part in LuGre friction."""
    none = jnp.zeros(())
    return Contact(velocity, none, Vanes(none, none))


def _bristle_after(friction: LuGre, contact: Contact, deflection: Scalar, time: Values) -> Values:
    """Deflection in m after `time` at a constant velocity."""
    rate = friction.relaxation(contact, Bristle(deflection)).deflection
    passed = rate * time
    small = passed < SMALL
    # At rest nothing decays: 0/0 in the value and in the derivative.
    safe = jnp.where(small, 1.0, passed)
    shrinking = jnp.where(small, 1 - passed / 2, -jnp.expm1(-safe) / safe)
    return deflection * jnp.exp(-passed) + contact.velocity * time * shrinking
