"""The hysteresis map: force from what loops at several turbine pressures differ by [3.16-3.17]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._types import Scalar, StateLeaf, Values
from ...parameters import parameter
from .._vanes import Crank, Vanes
from ._tables import AbstractVaneMap


class Direction(eqx.Module):
    """Which way the vanes last moved: 1 closing, -1 opening, between the two during a reversal."""

    sign: StateLeaf


class HysteresisMap(AbstractVaneMap):
    """Two tables over turbine pressure and crank angle, for closing vanes and for opening ones [3.16, 3.17, erratum
    14].

    The tables hold the whole force with its sign, positive against closing. A state follows the direction, `s' = (v -
    |v| s) / reversal_distance`, and with it the force goes from one table to the other. Linear between knots, held
    beyond them; zero at zero gauge pressure, linear from there to the first knot.
    """

    reversal_distance: Scalar = parameter(65e-6, symbol="x_rev", unit="m", source="assumed", above=0.0)
    crank: Crank = eqx.field(default_factory=Crank)

    def initial_state(self) -> Direction:
        """Between the directions."""
        return Direction(jnp.zeros_like(self.reversal_distance))

    def steady_direction(self, velocity: Values) -> Values:
        """`sign(v)`."""
        return jnp.sign(velocity)

    def __call__(self, vanes: Vanes, velocity: Values, state: Direction) -> tuple[Values, Direction]:
        """Force in N, and the rate of the direction in 1/s."""
        turning = (velocity - jnp.abs(velocity) * state.sign) / self.reversal_distance
        return self.force(vanes, state.sign), Direction(turning)

    def relaxation(self, vanes: Vanes, velocity: Values, state: Direction) -> Direction:
        """`|v| / reversal_distance`."""
        return Direction(jnp.abs(velocity) / self.reversal_distance)

    def signals(self, vanes: Vanes, velocity: Values, state: Direction) -> dict[str, Array]:
        """`f_vane` in N."""
        return {"f_vane": self.force(vanes, state.sign)}

    def typical_state(self) -> Direction:
        """One."""
        return Direction(jnp.ones_like(self.reversal_distance))
