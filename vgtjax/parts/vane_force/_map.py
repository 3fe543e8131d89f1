"""The hysteresis map: force from what loops at several turbine pressures differ by [3.16-3.17]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar, StateLeaf, Values
from ...parameters import parameter
from .._gas_table import AbstractGasTables, Table
from .._vanes import Crank, Vanes
from ._base import AbstractVaneForce

PRESSURES = (1.5e5, 3.0e5)
"""Pa gauge; the thesis's two operating points besides none (section 3.4.2)."""
ANGLES = (4.0, 10.0, 16.0, 22.0, 28.0, 34.0)
"""deg; from the closed stop to the open one of a travel of about 10 mm."""


class Direction(eqx.Module):
    """Which way the vanes last moved: 1 closing, -1 opening, between the two during a reversal."""

    sign: StateLeaf


class HysteresisMap(AbstractVaneForce, AbstractGasTables):
    """Two tables over turbine pressure and crank angle, for closing vanes and for opening ones [3.16, 3.17, erratum
    14].

    The tables hold the whole force with its sign, positive against closing. A state follows the direction, `s' = (v -
    |v| s) / reversal_distance`, and with it the force goes from one table to the other. Linear between knots, held
    beyond them; zero at zero gauge pressure, linear from there to the first knot.
    """

    closing: Table = parameter(
        (0.0,) * (len(PRESSURES) * len(ANGLES)), symbol="F_cl", unit="N", source="3.16", positive=False, assumed=True
    )
    """Force in N while the vanes close; a row of angles for every pressure, one row after the other."""
    opening: Table = parameter(
        (0.0,) * (len(PRESSURES) * len(ANGLES)), symbol="F_op", unit="N", source="3.16", positive=False, assumed=True
    )
    """Force in N while the vanes open."""
    turbine_pressure: Float[Array, " pressures"] = parameter(
        PRESSURES, symbol="p_trb", unit="Pa gauge", source="3.4.2", held=True
    )
    """Knots, increasing, above zero."""
    crank_angle: Float[Array, " angles"] = parameter(ANGLES, symbol="C_r", unit="deg", source="assumed", held=True)
    """Knots, increasing."""
    reversal_distance: Scalar = parameter(65e-6, symbol="x_rev", unit="m", source="assumed")
    crank: Crank = eqx.field(default_factory=Crank)

    @property
    def tables(self) -> dict[str, Table]:
        """`closing` and `opening`."""
        return {"closing": self.closing, "opening": self.opening}

    def initial_state(self) -> Direction:
        """Between the directions."""
        return Direction(jnp.zeros_like(self.reversal_distance))

    def force(self, vanes: Vanes, direction: Values) -> Values:
        """Force in N while the vanes close (direction 1), open (-1), or reverse (between)."""
        closing, opening = self.read(self.closing, vanes), self.read(self.opening, vanes)
        return 0.5 * (closing + opening) + 0.5 * direction * (closing - opening)

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
