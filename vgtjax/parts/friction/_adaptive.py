"""LuGre friction that grows with the exhaust gas on the vanes [3.18-3.20]."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Values
from ...parameters import parameter
from .._gas_table import AXES, OPERATING_POINTS, AbstractGasTables, Table
from .._vanes import Crank, Vanes
from ._bristles import SMALLEST_FORCE, AbstractPrintedLuGre
from ._lugre import warn_unless_passive

PRESSURES = OPERATING_POINTS[1:]
ANGLES = (4.0, 12.0, 20.0, 28.0, 36.0)
"""deg; from the closed stop to the open one of a travel of about 10 mm."""


class AdaptiveLuGre(AbstractPrintedLuGre, AbstractGasTables):
    """`F_f = theta F_LuGre` with `theta = 1 + load(p_trb, C_r) / F_c` [3.18-3.20, erratum].

    `load` is what exhaust gas adds to Coulomb friction: linear between knots, held beyond them, zero at zero gauge
    pressure and linear from there to the first knot. While it does not change, friction is passive where that of
    [`LuGre`][] is.
    """

    feels_gas: ClassVar[bool] = True

    load: Table = parameter(
        (0.0,) * (len(PRESSURES) * len(ANGLES)),
        symbol="F_load",
        unit="N",
        source="3.20",
        lower=0.0,
        assumed=True,
        axes=AXES,
    )
    """Sliding force in N that exhaust gas adds; a row of angles for every pressure, one row after the other."""
    turbine_pressure: Float[Array, " pressures"] = parameter(
        PRESSURES, symbol="p_trb", unit="Pa gauge", source="3.4.2", held=True
    )
    """Knots, increasing, above zero."""
    crank_angle: Float[Array, " angles"] = parameter(ANGLES, symbol="C_r", unit="deg", source="assumed", held=True)
    """Knots, increasing."""
    crank: Crank = eqx.field(default_factory=Crank)
    stribeck_exponent: int = eqx.field(static=True, default=1)
    """As in [`LuGre`][]."""

    def __check_init__(self) -> None:
        warn_unless_passive(self)

    def passivity_margin(self) -> Values:
        """`sigma_2` beyond its bound; while the load changes, friction may store and give back what it changes."""
        return self.spare_damping()

    def theta(self, vanes: Vanes) -> Values:
        """How many times its friction without exhaust gas the contact has; one at zero gauge pressure [3.20]."""
        load = self.read(self.load, vanes)
        return 1 + load / jnp.maximum(self.coulomb_force, SMALLEST_FORCE)
