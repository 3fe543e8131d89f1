"""Karnopp friction: a stiction band around zero velocity [3.1]."""

import equinox as eqx
import jax.numpy as jnp

from ..._errors import require_positive
from ..._types import Scalar, Values
from ...parameters import parameter
from .._stateless import Stateless
from ._base import AbstractFriction, Contact, DryFriction
from ._coulomb import sticking_damping, sticking_force


class Karnopp(Stateless, AbstractFriction):
    """A rod at rest holds up to `F_s`, one that slides feels `F_c sign(v) + sigma_2 v` [3.1, erratum].

    The dry force may reach `F_s` up to `velocity_band`, then the limit falls linearly to `F_c` at twice the band, so
    that nothing jumps. Sticking is that of [`Coulomb`][], and so is what is approximated. The viscous part is [2.35]'s.
    """

    static_force: Scalar = parameter(3.2, symbol="F_s", unit="N", source="B.2")
    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    velocity_band: float = eqx.field(static=True, default=1e-3)
    """Width in m/s; assumed, the size of LuGre's Stribeck velocity. The narrower, the more abrupt the break-away."""
    stick_time: float = eqx.field(static=True, default=1e-3)
    """Time constant in s with which a rod comes to rest; see [`Coulomb`][]."""

    def __check_init__(self) -> None:
        require_positive("velocity_band", self.velocity_band, "number of m/s", "use e.g. 0.001")
        require_positive("stick_time", self.stick_time, "number of s", "use e.g. 0.001")

    def limit(self, velocity: Values) -> Values:
        """The largest dry force in N at a velocity in m/s."""
        stiction = jnp.clip(2.0 - jnp.abs(velocity) / self.velocity_band, 0.0, 1.0)
        return self.coulomb_force + (self.static_force - self.coulomb_force) * stiction

    def damping(self, contact: Contact) -> Values:
        """That of [`Coulomb`][]; in the band's flank the force falls with velocity, which no damping does."""
        return sticking_damping(self.limit(contact.velocity), self.viscous_damping, self.stick_time, contact)

    def __call__(self, contact: Contact, state: None, applied_force: Values) -> tuple[Values, None]:
        """Force in N under an applied force in N."""
        limit = self.limit(contact.velocity)
        return sticking_force(limit, self.viscous_damping, self.stick_time, contact, applied_force), None

    def steady_force(self, contact: Contact) -> Values:
        """`F(v) sign(v) + sigma_2 v` with the limit `F(v)`."""
        velocity = contact.velocity
        return self.limit(velocity) * jnp.sign(velocity) + self.viscous_damping * velocity

    def passivity_margin(self) -> None:
        """It can't give out energy."""

    def dry(self) -> DryFriction:
        """With stiction in a band, without bristles."""
        return DryFriction(self.coulomb_force, self.static_force, self.viscous_damping)
