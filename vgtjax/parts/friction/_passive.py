"""LuGre friction in parameters with which it can't generate energy."""

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array

from ..._errors import InputError
from ...parameters import parameter
from .._air import Scalar
from ._base import AbstractFriction, Contact
from ._lugre import Bristle, LuGre, least_damping


class PassiveLuGre(AbstractFriction):
    """[`LuGre`][] with `F_s = F_c + drop` and `sigma_2 = sigma_1 drop / F_c + excess` [3.6-3.7].

    For fits: passivity is a condition on three parameters of LuGre together, here it is two bounds at zero. `drop` and
    `excess` are not positive by logarithm, as both bounds mean something and a fit must be able to reach them: no
    stiction at all, and friction that is just passive. The defaults are the printed parameters.
    """

    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    stribeck_drop: Scalar = parameter(0.4, symbol="F_s-F_c", unit="N", source="B.2", positive=False, lower=0.0)
    bristle_stiffness: Scalar = parameter(43135.0, symbol="sigma_0", unit="N/m", source="B.2")
    bristle_damping: Scalar = parameter(429.77, symbol="sigma_1", unit="N s/m", source="B.2")
    excess_damping: Scalar = parameter(
        206.0 - 429.77 * 0.4 / 2.8, symbol="sigma_2-b", unit="N s/m", source="B.2", positive=False, lower=0.0
    )
    """Viscous damping above the bound of passivity."""
    stribeck_velocity: Scalar = parameter(1e-3, symbol="v_s", unit="m/s", source="B.2")
    stribeck_exponent: int = eqx.field(static=True, default=1)
    """As in [`LuGre`][]."""

    def __check_init__(self) -> None:
        for name in ("stribeck_drop", "excess_damping"):
            check_not_negative(name, getattr(self, name))
        _ = self.lugre  # its own rules

    @property
    def lugre(self) -> LuGre:
        """The same friction in the thesis's parameters."""
        static = self.coulomb_force + self.stribeck_drop
        least = least_damping(static, self.coulomb_force, self.bristle_damping)
        return LuGre(
            static,
            self.coulomb_force,
            self.bristle_stiffness,
            self.bristle_damping,
            least + self.excess_damping,
            self.stribeck_velocity,
            self.stribeck_exponent,
        )

    def initial_state(self) -> Bristle:
        """A relaxed bristle."""
        return Bristle(jnp.zeros_like(self.coulomb_force))

    def relaxation(self, contact: Contact, state: Bristle) -> Bristle:
        """That of LuGre."""
        return self.lugre.relaxation(contact, state)

    def damping(self, contact: Contact) -> Scalar:
        """That of LuGre."""
        return self.lugre.damping(contact)

    def __call__(self, contact: Contact, state: Bristle, applied_force: Scalar) -> tuple[Scalar, Bristle]:
        """Force [3.6]; the applied force plays no part."""
        return self.lugre(contact, state, applied_force)

    def signals(self, state: Bristle) -> dict[str, Array]:
        """The deflection `z` in m."""
        return self.lugre.signals(state)

    def typical_state(self) -> Bristle:
        """The deflection at break-away."""
        return self.lugre.typical_state()


def check_not_negative(name: str, values: Array) -> None:
    """Whether a parameter of friction lies inside its domain; says nothing while it is traced.

    **Raises:** `InputError` otherwise.
    """
    if isinstance(values, jax.core.Tracer):
        return
    least = float(values.min())
    if not least >= 0:
        raise InputError(f"friction.{name} must not be negative, but it is {least:g}; use 0 or more")
