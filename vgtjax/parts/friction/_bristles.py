"""The law of LuGre friction, for every choice of parameters [3.6-3.7] (Canudas de Wit et al., 1995)."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._errors import InputError, is_traced
from ..._types import Scalar, StateLeaf, Values
from ...parameters import parameter
from .._vanes import Vanes
from ._base import AbstractFriction, Contact, DryFriction

SMALLEST_FORCE = 1e-9
"""N. A rod without friction has bristles all the same: they give way at once, but not at zero over zero."""


class Bristle(eqx.Module):
    """State of LuGre friction: mean deflection of the bristles in m."""

    deflection: StateLeaf


class AbstractLuGre(AbstractFriction):
    """`z' = v - sigma_0 |v| z / g(v)`, `F_f = theta (sigma_0 z + sigma_1 z' + sigma_2 v)` [3.6, 3.18]; continuous."""

    static_force: eqx.AbstractVar[Scalar]
    coulomb_force: eqx.AbstractVar[Scalar]
    bristle_stiffness: eqx.AbstractVar[Scalar]
    bristle_damping: eqx.AbstractVar[Scalar]
    viscous_damping: eqx.AbstractVar[Scalar]
    stribeck_velocity: eqx.AbstractVar[Scalar]
    stribeck_exponent: eqx.AbstractVar[int]

    def __check_init__(self) -> None:
        if self.stribeck_exponent not in (1, 2):
            raise InputError(
                f"stribeck_exponent must be 1 [3.7] or 2 [5.62], but it is {self.stribeck_exponent}; use one of these"
            )

    @abc.abstractmethod
    def theta(self, vanes: Vanes) -> Values | float:
        """How many times its friction without exhaust gas the contact has."""

    def passivity_bound(self) -> Values:
        """The least viscous damping in N s/m with which friction is passive, `sigma_1 (F_s - F_c) / F_c`."""
        return least_damping(self.static_force, self.coulomb_force, self.bristle_damping)

    def spare_damping(self) -> Values:
        """`sigma_2` beyond that bound in N s/m."""
        values = (self.static_force, self.coulomb_force, self.bristle_damping, self.viscous_damping)
        # NumPy where it will do: outside of jit every operation of JAX would be compiled by itself.
        static, coulomb, bristle, viscous = values if is_traced(values) else map(np.asarray, values)
        return viscous - least_damping(static, coulomb, bristle)

    def initial_state(self) -> Bristle:
        """A relaxed bristle."""
        return Bristle(jnp.zeros_like(self.coulomb_force))

    def stribeck(self, velocity: Values) -> Values:
        """Steady sliding force without its viscous part in N: `F_c + (F_s - F_c) exp(-(|v|/v_s)^n)` [3.7, 5.62]."""
        force = self.coulomb_force + (self.static_force - self.coulomb_force) * self._falling(velocity)
        return jnp.maximum(force, SMALLEST_FORCE)

    def stribeck_slope(self, velocity: Values) -> Values:
        """`dg/dv` in N s/m; zero where the velocity is, a jump when the exponent is 1."""
        power, falls = self.stribeck_exponent, self.stribeck_velocity > 0
        width = jnp.where(falls, self.stribeck_velocity, 1.0)
        steepness = power * (jnp.abs(velocity) / width) ** (power - 1) / width
        drop = (self.static_force - self.coulomb_force) * steepness * self._falling(velocity)
        return -drop * jnp.sign(velocity)

    def _falling(self, velocity: Values) -> Values:
        """`exp(-(|v|/v_s)^n)`; zero where `v_s` is."""
        falls = self.stribeck_velocity > 0
        ratio = jnp.abs(velocity) / jnp.where(falls, self.stribeck_velocity, 1.0)
        return jnp.where(falls, jnp.exp(-ratio if self.stribeck_exponent == 1 else -ratio * ratio), 0.0)

    def steady_force(self, contact: Contact) -> Values:
        """`theta (g(v) sign(v) + sigma_2 v)`."""
        velocity = contact.velocity
        sliding = self.stribeck(velocity) * jnp.sign(velocity) + self.viscous_damping * velocity
        return self.theta(contact.vanes) * sliding

    def relaxation(self, contact: Contact, state: Bristle) -> Bristle:
        """`sigma_0 |v| / g(v)`; a load stiffens the bristles and raises the force at which they slip alike."""
        return Bristle(self.relaxation_rate(contact.velocity))

    def relaxation_rate(self, velocity: Values) -> Values:
        """`sigma_0 |v| / g(v)` in 1/s."""
        return self.bristle_stiffness * jnp.abs(velocity) / self.stribeck(velocity)

    def deflection_after(self, deflection: Values, pull: Values, velocity: Values, period: float) -> Values:
        """Deflection in m a period in s later, by one step of implicit Euler, of bristles that are pulled at `pull` m/s
        on a rod at a velocity in m/s: fast sliding relaxes within less than a sample."""
        return (deflection + period * pull) / (1 + period * self.relaxation_rate(velocity))

    def damping(self, contact: Contact) -> Values:
        """`theta (sigma_1 + sigma_2)`, the slope while the bristles stick."""
        return self.theta(contact.vanes) * (self.bristle_damping + self.viscous_damping)

    def __call__(self, contact: Contact, state: Bristle, applied_force: Values) -> tuple[Values, Bristle]:
        """Force [3.6, 3.18]; the applied force plays no part."""
        velocity = contact.velocity
        sliding = self.bristle_stiffness * jnp.abs(velocity) * state.deflection / self.stribeck(velocity)
        rate = velocity - sliding
        return self.theta(contact.vanes) * self.unloaded_force(state.deflection, rate, velocity), Bristle(rate)

    def unloaded_force(self, deflection: Values, rate: Values, velocity: Values) -> Values:
        """`sigma_0 z + sigma_1 z' + sigma_2 v` in N."""
        return self.bristle_stiffness * deflection + self.bristle_damping * rate + self.viscous_damping * velocity

    def dry(self) -> DryFriction:
        """All of its parameters."""
        return DryFriction(
            self.coulomb_force,
            self.static_force,
            self.viscous_damping,
            self.bristle_stiffness,
            self.bristle_damping,
            self.stribeck_velocity,
            self.stribeck_exponent,
        )

    def signals(self, state: Bristle) -> dict[str, Array]:
        """The deflection `z` in m."""
        return {"z": state.deflection}

    def typical_state(self) -> Bristle:
        """The deflection at break-away."""
        return Bristle(self.static_force / self.bristle_stiffness)


class AbstractPrintedLuGre(AbstractLuGre):  # type: ignore[misc]  # mypy takes abstract variables for fields
    """LuGre friction in the thesis's own parameters [3.6-3.7]."""

    static_force: Scalar = parameter(3.2, symbol="F_s", unit="N", source="B.2")
    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    bristle_stiffness: Scalar = parameter(43135.0, symbol="sigma_0", unit="N/m", source="B.2")
    bristle_damping: Scalar = parameter(429.77, symbol="sigma_1", unit="N s/m", source="B.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    stribeck_velocity: Scalar = parameter(1e-3, symbol="v_s", unit="m/s", source="B.2")


def least_damping(static_force: Values, coulomb_force: Values, bristle_damping: Values) -> Values:
    """The bound of [`AbstractLuGre.passivity_bound`][] in N s/m."""
    numbers: Any = jnp if is_traced(static_force, coulomb_force) else np
    smaller = numbers.maximum(numbers.minimum(static_force, coulomb_force), SMALLEST_FORCE)
    return bristle_damping * abs(static_force - coulomb_force) / smaller
