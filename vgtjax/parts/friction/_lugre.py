"""LuGre friction [3.6-3.7] (Canudas de Wit, Olsson, Astrom and Lischinsky, 1995)."""

import warnings
from types import ModuleType

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._errors import InputError
from ...parameters import parameter
from .._air import Scalar
from ._base import AbstractFriction, Contact

SMALLEST_FORCE = 1e-9
"""N. A rod without friction has bristles all the same: they give way at once, but not at zero over zero."""


class PassivityWarning(UserWarning):
    """Friction with these parameters can generate energy."""


class Bristle(eqx.Module):
    """State of LuGre friction: mean deflection of the bristles in m."""

    deflection: Scalar


class LuGre(AbstractFriction):
    """`z' = v - sigma_0 |v| z / g(v)`, `F_f = sigma_0 z + sigma_1 z' + sigma_2 v` [3.6].

    The right side is continuous with a kink at `v = 0`; nothing is smoothed. Parameters with which it can generate
    energy are legal, but constructing it with them gives a [`PassivityWarning`][], see `passivity_bound`.
    """

    static_force: Scalar = parameter(3.2, symbol="F_s", unit="N", source="B.2")
    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    bristle_stiffness: Scalar = parameter(43135.0, symbol="sigma_0", unit="N/m", source="B.2")
    bristle_damping: Scalar = parameter(429.77, symbol="sigma_1", unit="N s/m", source="B.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    stribeck_velocity: Scalar = parameter(1e-3, symbol="v_s", unit="m/s", source="B.2")
    stribeck_exponent: int = eqx.field(static=True, default=1)
    """Power of `|v| / v_s` in the Stribeck curve: 1 as in [3.7], or 2 as in [5.62]."""

    def __check_init__(self) -> None:
        if self.stribeck_exponent not in (1, 2):
            raise InputError(
                f"stribeck_exponent must be 1 [3.7] or 2 [5.62], but it is {self.stribeck_exponent}; use one of these"
            )
        _warn_unless_passive(self.static_force, self.coulomb_force, self.bristle_damping, self.viscous_damping)

    def passivity_bound(self) -> Scalar:
        """The smallest viscous damping in N s/m with which friction never generates energy.

        `sigma_1 (F_s - F_c) / F_c`: bristles stretched by stiction that a sudden slip unloads push with `sigma_1 z'`.
        """
        return least_damping(self.static_force, self.coulomb_force, self.bristle_damping)

    def initial_state(self) -> Bristle:
        """A relaxed bristle."""
        return Bristle(jnp.zeros_like(self.static_force))

    def stribeck(self, velocity: Scalar) -> Scalar:
        """Steady sliding force without its viscous part in N: `F_c + (F_s - F_c) exp(-(|v|/v_s)^n)` [3.7, 5.62]."""
        ratio = jnp.abs(velocity) / self.stribeck_velocity
        falling = jnp.exp(-ratio if self.stribeck_exponent == 1 else -ratio * ratio)
        force = self.coulomb_force + (self.static_force - self.coulomb_force) * falling
        return jnp.maximum(force, SMALLEST_FORCE)

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


def least_damping(static_force: Scalar, coulomb_force: Scalar, bristle_damping: Scalar, xp: ModuleType = jnp) -> Scalar:
    """Viscous damping in N s/m from which LuGre friction is passive, `sigma_1 (F_s - F_c) / F_c`.

    With `sigma_0 z^2 / 2` stored, the loss at `v > 0` is at least `(sigma_1 + sigma_2 - sigma_1 sigma_0 z / g) v^2`;
    `sigma_0 z / g` is at most the larger of `F_s` and `F_c` over the smaller.
    """
    smaller = xp.maximum(xp.minimum(static_force, coulomb_force), SMALLEST_FORCE)
    return bristle_damping * abs(static_force - coulomb_force) / smaller


def _warn_unless_passive(static: Scalar, coulomb: Scalar, bristle: Scalar, viscous: Scalar) -> None:
    if any(isinstance(value, jax.core.Tracer) for value in (static, coulomb, bristle, viscous)):
        return
    # NumPy: outside of jit every operation of JAX would be compiled by itself, and inside it would be traced.
    bound = least_damping(np.asarray(static), np.asarray(coulomb), np.asarray(bristle), xp=np)
    given, least = np.broadcast_arrays(np.asarray(viscous), np.asarray(bound))
    worst = np.argmax(least - given)
    if np.any(given < least):
        warnings.warn(
            f"friction.viscous_damping must be at least {least.flat[worst]:.6g} N s/m for passive LuGre friction, "
            f"but it is {given.flat[worst]:.6g} and may generate energy; raise it, lower bristle_damping, or use "
            "PassiveLuGre",
            PassivityWarning,
            stacklevel=4,
        )
