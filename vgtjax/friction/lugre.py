"""LuGre friction [3.6-3.7] (Canudas de Wit, Olsson, Astrom and Lischinsky, 1995)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..air import Scalar
from ..parameters import parameter
from .base import AbstractFriction, Contact


class Bristle(eqx.Module):
    """State of LuGre friction: mean deflection of the bristles in m."""

    deflection: Scalar


class LuGre(AbstractFriction):
    """`z' = v - sigma_0 |v| z / g(v)`, `F_f = sigma_0 z + sigma_1 z' + sigma_2 v` [3.6].

    The right side is continuous with a kink at `v = 0`; nothing is smoothed.
    """

    static_force: Scalar = parameter(3.2, symbol="F_s", unit="N", source="B.2")
    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    bristle_stiffness: Scalar = parameter(43135.0, symbol="sigma_0", unit="N/m", source="B.2")
    bristle_damping: Scalar = parameter(429.77, symbol="sigma_1", unit="N s/m", source="B.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    stribeck_velocity: Scalar = parameter(1e-3, symbol="v_s", unit="m/s", source="B.2")

    def initial_state(self) -> Bristle:
        """A relaxed bristle."""
        return Bristle(jnp.zeros_like(self.static_force))

    def stribeck(self, velocity: Scalar) -> Scalar:
        """Steady sliding force without its viscous part in N: `F_c + (F_s - F_c) exp(-|v|/v_s)` [3.7]."""
        falling = jnp.exp(-jnp.abs(velocity) / self.stribeck_velocity)
        # A rod without friction has bristles all the same: they give way at once, but not at zero over zero.
        return jnp.maximum(self.coulomb_force + (self.static_force - self.coulomb_force) * falling, 1e-9)

    def relaxation(self, contact: Contact, state: Bristle) -> Bristle:
        """`sigma_0 |v| / g(v)`."""
        return Bristle(self.bristle_stiffness * jnp.abs(contact.velocity) / self.stribeck(contact.velocity))

    def damping(self, contact: Contact) -> Scalar:
        """`sigma_1 + sigma_2`, the slope while the bristles stick."""
        return self.bristle_damping + self.viscous_damping

    def __call__(self, contact: Contact, state: Bristle, applied_force: Scalar) -> tuple[Scalar, Bristle]:
        """Force [3.6]; the applied force plays no part."""
        velocity = contact.velocity
        sliding = self.bristle_stiffness * jnp.abs(velocity) * state.deflection / self.stribeck(velocity)
        rate = velocity - sliding
        force = (
            self.bristle_stiffness * state.deflection + self.bristle_damping * rate + self.viscous_damping * velocity
        )
        return force, Bristle(rate)

    def signals(self, state: Bristle) -> dict[str, Array]:
        """The deflection `z` in m."""
        return {"z": state.deflection}

    def typical_state(self) -> Bristle:
        """The deflection at break-away."""
        return Bristle(self.static_force / self.bristle_stiffness)
