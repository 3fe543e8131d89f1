"""The force of the exhaust gas on the vanes along a known motion of the rod, as far as a controller knows it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from .._types import Scalar
from ..parts import AbstractVaneForce, Diaphragm, Vanes


class Motion(eqx.Module):
    """Position in m and velocity in m/s of the rod as they are known, atmosphere in Pa, turbine inlet in Pa gauge."""

    position: Scalar
    velocity: Scalar
    ambient: Scalar
    turbine: Scalar = eqx.field(default_factory=lambda: jnp.zeros(()))


def vane_load(law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: Any) -> tuple[Scalar, PyTree[Scalar]]:
    """Force in N along -x, and how fast what the force remembers changes, per second."""
    return law(_vanes(body, motion), motion.velocity, state)


def vane_load_rate(law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: Any) -> Scalar:
    """Time derivative of the force in N/s, at a constant turbine pressure and velocity."""

    def force(position: Scalar, state: Any) -> Scalar:
        return vane_load(law, body, Motion(position, motion.velocity, motion.ambient, motion.turbine), state)[0]

    along = (motion.velocity, vane_load(law, body, motion, state)[1])
    return jax.jvp(force, (motion.position, state), along)[1]


def vane_state_after(
    law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: Any, period: float
) -> PyTree[Scalar]:
    """What the force remembers a period in s later, by one step of implicit Euler."""
    relaxation = law.relaxation(_vanes(body, motion), motion.velocity, state)
    rates = vane_load(law, body, motion, state)[1]
    return jax.tree.map(lambda s, rate, fade: s + period * rate / (1 + period * fade), state, rates, relaxation)


def _vanes(body: Diaphragm, motion: Motion) -> Vanes:
    return Vanes(body.travel - motion.position, motion.turbine)
