"""Step response of the diaphragm without dry friction in closed form [4.3-4.5], corrected; the manual's page on studies
derives it."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._errors import InputError, is_traced
from .._types import Scalar, Values
from ..parts import Diaphragm, LuGre

SERIES_WITHIN = 1.0
"""Size of `u` up to which the power series is summed: far from the root's infinite slope at zero."""
TERMS = 10
"""Of the series; the first left out is below `1 / 20!`, beyond double precision."""


def frictionless_diaphragm(diaphragm: Diaphragm, friction: LuGre) -> Diaphragm:
    """The diaphragm with all viscous damping in its own, `b_d + sigma_2`, which is what [4.5] needs (erratum)."""
    return eqx.tree_at(lambda part: part.damping, diaphragm, diaphragm.damping + friction.viscous_damping)


def natural_frequency(diaphragm: Diaphragm) -> Scalar:
    """`omega_n = sqrt(k_sm / m_d)` in rad/s [4.5]."""
    return jnp.sqrt(diaphragm.stiffness / diaphragm.mass)


def damping_ratio(diaphragm: Diaphragm) -> Scalar:
    """`zeta = b / (2 sqrt(m_d k_sm))` [4.5] with the diaphragm's own damping; see [`frictionless_diaphragm`][]."""
    return diaphragm.damping / (2 * jnp.sqrt(diaphragm.mass * diaphragm.stiffness))


def step_response(diaphragm: Diaphragm, pressure: Scalar, time: Values) -> Values:
    """Position in m after a step of the applied pressure [4.4], corrected.

    Area, mass, stiffness and damping act; preload and stops don't. All derivatives exist, at critical damping too.

    **Arguments:** `pressure` applied in Pa, `p_atm - p_act`; `time` since the step in s, zero or more.

    **Raises:** `InputError` when mass or stiffness is not positive or the damping negative; not while they are traced.
    """
    for name, lowest in (("mass", "positive"), ("stiffness", "positive"), ("damping", "zero or more")):
        _check(name, getattr(diaphragm, name), lowest)
    decay = diaphragm.damping / (2 * diaphragm.mass) * time
    swing = diaphragm.stiffness / diaphragm.mass * time**2
    cosine, sine = _decaying_pair(decay, swing)
    return diaphragm.area / diaphragm.stiffness * pressure * (1 - cosine - decay * sine)


def _decaying_pair(d: Array, swing: Array) -> tuple[Array, Array]:
    """`e^(-d) C(u)` and `e^(-d) S(u)` at `u = d^2 - swing`."""
    u = d * d - swing
    over, under = u > SERIES_WITHIN, u < -SERIES_WITHIN
    # Each branch gets an argument at which it is finite, or its derivative were NaN where it is not chosen.
    creeping = _overdamped(jnp.where(over, d, 2.0), jnp.where(over, swing, 1.0))
    swinging = _underdamped(d, jnp.where(under, u, -1.0))
    near = _series(d, jnp.where(over | under, 0.0, u))
    cosine, sine = (
        jnp.where(over, a, jnp.where(under, b, c)) for a, b, c in zip(creeping, swinging, near, strict=True)
    )
    return cosine, sine


def _overdamped(d: Array, swing: Array) -> tuple[Array, Array]:
    root = jnp.sqrt(d * d - swing)
    # d - root without cancellation; the growing part of cosh would overflow before e^(-d) brings it back.
    slow = jnp.exp(-swing / (d + root))
    return slow * (1 + jnp.exp(-2 * root)) / 2, slow * -jnp.expm1(-2 * root) / (2 * root)


def _underdamped(d: Array, u: Array) -> tuple[Array, Array]:
    root = jnp.sqrt(-u)
    return jnp.exp(-d) * jnp.cos(root), jnp.exp(-d) * jnp.sin(root) / root


def _series(d: Array, u: Array) -> tuple[Array, Array]:
    cosine, sine = (
        jnp.polyval(jnp.asarray([1 / math.factorial(2 * n + odd) for n in reversed(range(TERMS))], dtype=u.dtype), u)
        for odd in (0, 1)
    )
    return jnp.exp(-d) * cosine, jnp.exp(-d) * sine


def _check(name: str, value: Array, lowest: str) -> None:
    if is_traced(value):
        return
    # NumPy, or a constant inside of jit would be traced.
    least = float(np.min(np.asarray(value)))
    if not (least > 0 or (least == 0 and lowest != "positive")):
        raise InputError(
            f"diaphragm.{name} must be {lowest} for the step response [4.4], but it is {least:g}; give such a value"
        )
