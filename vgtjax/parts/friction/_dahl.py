"""Dahl friction [3.2-3.5] (Dahl, 1968)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._errors import require_positive
from ..._types import Scalar, Values
from ...parameters import parameter
from ._base import AbstractFriction, Contact, DryFriction
from ._bristles import SMALLEST_FORCE, Bristle


class Dahl(AbstractFriction):
    """`z' = v (1 - sigma z sign(v) / F_c)^alpha`, `F_f = sigma z + sigma_2 v` [3.2-3.5].

    LuGre without stiction and bristle damping; its loops depend on the path, not on speed. With the usual `alpha = 1`
    it is `z' = v - sigma |v| z / F_c` [3.5], without a power. Steps must stay below `2 sqrt(m / sigma)`.
    """

    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="3.3.2.2")
    bristle_stiffness: Scalar = parameter(42150.0, symbol="sigma", unit="N/m", source="3.3.2.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    shape_exponent: float = eqx.field(static=True, default=1.0)
    """`alpha`: how a bristle gives way, above 1 gradually, below 1 abruptly. Chosen, not fitted: the thesis prints no
    other value than 1, which costs no power this way."""

    def __check_init__(self) -> None:
        remedy = "use 1 unless a measured loop has another shape"
        require_positive("shape_exponent", self.shape_exponent, "number", remedy)

    def initial_state(self) -> Bristle:
        """A relaxed bristle."""
        return Bristle(jnp.zeros_like(self.bristle_stiffness))

    def relaxation(self, contact: Contact, state: Bristle) -> Bristle:
        """`alpha sigma |v| / F_c` times the power `alpha - 1` of what is left to slide; its bound for `alpha < 1`."""
        rate = self.bristle_stiffness * jnp.abs(contact.velocity) / self._limit
        if self.shape_exponent == 1:
            return Bristle(rate)
        return Bristle(rate * max(self.shape_exponent, 1.0) * self._power(self._left(contact, state)))

    def damping(self, contact: Contact) -> Values:
        """`sigma_2`; the bristles have none."""
        return self.viscous_damping

    def __call__(self, contact: Contact, state: Bristle, applied_force: Values) -> tuple[Values, Bristle]:
        """Force in N; the applied force plays no part."""
        velocity = contact.velocity
        if self.shape_exponent == 1:
            rate = velocity - self.bristle_stiffness * jnp.abs(velocity) * state.deflection / self._limit
        else:
            left = self._left(contact, state)
            rate = velocity * left * self._power(left)
        return self.bristle_stiffness * state.deflection + self.viscous_damping * velocity, Bristle(rate)

    def steady_force(self, contact: Contact) -> Values:
        """`F_c sign(v) + sigma_2 v`."""
        return self._limit * jnp.sign(contact.velocity) + self.viscous_damping * contact.velocity

    def passivity_margin(self) -> None:
        """It can't give out energy."""

    def dry(self) -> DryFriction:
        """Bristles without stiction or damping."""
        return DryFriction(self.coulomb_force, self.coulomb_force, self.viscous_damping, self.bristle_stiffness)

    def signals(self, state: Bristle) -> dict[str, Array]:
        """The deflection `z` in m."""
        return {"z": state.deflection}

    def typical_state(self) -> Bristle:
        """The deflection of a sliding rod."""
        return Bristle(self.coulomb_force / self.bristle_stiffness)

    @property
    def _limit(self) -> Values:
        return jnp.maximum(self.coulomb_force, SMALLEST_FORCE)

    def _left(self, contact: Contact, state: Bristle) -> Values:
        """`1 - F sign(v) / F_c`: zero where the bristle slides, two where a sliding one turns round."""
        return 1 - jnp.sign(contact.velocity) * self.bristle_stiffness * state.deflection / self._limit

    def _power(self, left: Values) -> Values:
        """`|left|^(alpha - 1)`, held below a thousandth: there an exponent below one would have an infinite slope."""
        return jnp.exp((self.shape_exponent - 1) * jnp.log(jnp.maximum(jnp.abs(left), 1e-3)))
