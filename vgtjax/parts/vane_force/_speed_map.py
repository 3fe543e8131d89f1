"""The map whose sides change with the rod's speed [3.16-3.17]."""

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar, Values
from ...parameters import parameter
from .._vanes import Crank, Vanes
from ._base import AbstractStatelessVaneForce
from ._tables import AbstractVaneMap


class SpeedMap(AbstractVaneMap, AbstractStatelessVaneForce):
    """The tables of [`HysteresisMap`][], between which the force goes with the speed; no state [3.16, 3.17].

    The direction is `tanh(v / side_speed)`, 1 while the vanes close, -1 while they open, between the two within a few
    `side_speed`; the independent plant that wrote the examples has the same. So around rest the force damps the rod,
    and a loaded rod creeps.
    """

    side_speed: Scalar = parameter(1e-3, symbol="v_side", unit="m/s", source="assumed", above=0.0)
    crank: Crank = eqx.field(default_factory=Crank)

    def steady_direction(self, velocity: Values) -> Values:
        """`tanh(v / side_speed)`, also of vanes that don't move steadily."""
        return jnp.tanh(velocity / self.side_speed)

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Force in N."""
        return self.force(vanes, self.steady_direction(velocity)), None

    def damping(self, vanes: Vanes, velocity: Values) -> Values:
        """Slope of the force over velocity in N s/m, from rest to the present velocity.

        At rest it is the derivative, half the tables' difference over `side_speed`; the manual's page on physics says
        why it is not the derivative elsewhere. Its size counts, also where tables cross.
        """
        across = jnp.abs(self.read(self.closing, vanes) - self.read(self.opening, vanes))
        return 0.5 * across / jnp.sqrt(velocity**2 + self.side_speed**2)
