"""Coulomb friction that sticks without a jump and without creep [2.35]."""

import equinox as eqx
import jax.numpy as jnp

from ..._errors import require_positive
from ..._types import Scalar, Values
from ...parameters import parameter
from .._stateless import Stateless
from ._base import AbstractFriction, Contact, DryFriction
from ._bristles import SMALLEST_FORCE


class Coulomb(Stateless, AbstractFriction):
    """`F_f = F_c sign(v) + sigma_2 v`; at rest the force that holds the rod, up to `F_c` [2.35].

    The dry part opposes the velocity that the rod would have one `stick_time` later without it, `clip(F_a - sigma_2 v +
    m v / stick_time, -F_c, F_c)` with the applied force `F_a`: continuous, without creep. The manual's page on physics
    says what that approximates, and how to tighten it.
    """

    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    viscous_damping: Scalar = parameter(206.0, symbol="sigma_2", unit="N s/m", source="B.2")
    stick_time: float = eqx.field(static=True, default=1e-3)
    """Time constant in s with which a rod comes to rest; the manual says how to tighten it."""

    def __check_init__(self) -> None:
        require_positive("stick_time", self.stick_time, "number of s", "use e.g. 0.001")

    def damping(self, contact: Contact) -> Values:
        """`m / stick_time` at velocities at which a rod may stick, `sigma_2` from twice those on."""
        return sticking_damping(self.coulomb_force, self.viscous_damping, self.stick_time, contact)

    def __call__(self, contact: Contact, state: None, applied_force: Values) -> tuple[Values, None]:
        """Force in N under an applied force in N."""
        return sticking_force(self.coulomb_force, self.viscous_damping, self.stick_time, contact, applied_force), None

    def steady_force(self, contact: Contact) -> Values:
        """`F_c sign(v) + sigma_2 v`."""
        return self.coulomb_force * jnp.sign(contact.velocity) + self.viscous_damping * contact.velocity

    def passivity_margin(self) -> None:
        """It can't give out energy."""

    def dry(self) -> DryFriction:
        """Without stiction and bristles."""
        return DryFriction(self.coulomb_force, self.coulomb_force, self.viscous_damping)


def sticking_damping(limit: Values, viscous: Values, stick_time: float, contact: Contact) -> Values:
    """Damping in N s/m of dry friction up to `limit` in N that stops a rod within `stick_time` in s."""
    stuck = jnp.maximum(contact.mass / stick_time, viscous)
    # A load below F_c stops the rod from 2 F_c stick_time / m at most. The larger damping at any velocity would be
    # as stable, but a step five times stick_time was then off by 54 um instead of 1.4 on a 3 Hz sweep of 3 mm.
    reach = 2 * jnp.maximum(limit, SMALLEST_FORCE) * stick_time
    slow = jnp.clip(2.0 - contact.mass * jnp.abs(contact.velocity) / reach, 0.0, 1.0)
    return viscous + (stuck - viscous) * slow


def sticking_force(
    limit: Values, viscous: Values, stick_time: float, contact: Contact, applied_force: Values
) -> Values:
    """Force in N of the same friction with a viscous part, under an applied force in N."""
    slowing = viscous * contact.velocity
    # The viscous part is taken out before clipping and comes back after it: stuck, the two cancel exactly.
    holding = applied_force - slowing + contact.mass * contact.velocity / stick_time
    return jnp.clip(holding, -limit, limit) + slowing
