"""What the maps of the force have in common: a table for closing vanes and one for opening ones [3.16-3.17]."""

import abc
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from ..._types import Values
from ...parameters import parameter
from .._gas_table import AXES, OPERATING_POINTS, AbstractGasTables, Table
from .._vanes import Vanes
from ._base import AbstractVaneForce

PRESSURES = OPERATING_POINTS[1:]
ANGLES = (4.0, 10.0, 16.0, 22.0, 28.0, 34.0)
"""deg; from the closed stop to the open one of a travel of about 10 mm."""
EMPTY = (0.0,) * (len(PRESSURES) * len(ANGLES))


class AbstractVaneMap(AbstractVaneForce, AbstractGasTables):  # type: ignore[misc]  # mypy takes crank for a field
    """Two tables over turbine pressure and crank angle; how the force goes from one to the other is the variant's.

    The tables hold the whole force with its sign, positive against closing. Linear between knots, held beyond them;
    zero at zero gauge pressure, linear from there to the first knot.
    """

    equations: ClassVar[str] = "3.16-3.17"
    closing: Table = parameter(EMPTY, symbol="F_cl", unit="N", source="3.16", positive=False, assumed=True, axes=AXES)
    """Force in N while the vanes close; a row of angles for every pressure, one row after the other."""
    opening: Table = parameter(EMPTY, symbol="F_op", unit="N", source="3.16", positive=False, assumed=True, axes=AXES)
    """Force in N while the vanes open."""
    turbine_pressure: Float[Array, " pressures"] = parameter(
        PRESSURES, symbol="p_trb", unit="Pa gauge", source="3.4.2", held=True
    )
    """Knots, increasing, above zero."""
    crank_angle: Float[Array, " angles"] = parameter(ANGLES, symbol="C_r", unit="deg", source="assumed", held=True)
    """Knots, increasing."""

    @property
    def acts(self) -> bool:
        """Whether its tables have anything in them."""
        return any(np.any(table) for table in self.tables.values())

    @abc.abstractmethod
    def steady_direction(self, velocity: Values) -> Values:
        """Direction, from -1 to 1, of vanes that move steadily at a velocity in m/s."""

    def steady_force(self, vanes: Vanes, velocity: Values) -> Values:
        """That of the steady direction."""
        return self.force(vanes, self.steady_direction(velocity))

    def force(self, vanes: Vanes, direction: Values) -> Values:
        """Force in N while the vanes close (direction 1), open (-1), or reverse (between)."""
        closing, opening = self.read(self.closing, vanes), self.read(self.opening, vanes)
        return 0.5 * (closing + opening) + 0.5 * direction * (closing - opening)
