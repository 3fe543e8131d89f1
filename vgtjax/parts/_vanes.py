"""The vanes and the crank that turns them [3.14]."""

import equinox as eqx
import jax.numpy as jnp

from .._types import Scalar, Values
from ..parameters import Part, parameter


class Vanes(eqx.Module):
    """Where the vanes are and what blows at them."""

    opening: Values
    """Distance of the rod from its closed end of travel, `travel - x_d`, in m."""
    turbine_pressure: Values
    """Pressure at the turbine inlet in Pa gauge."""
    ambient_shift: Values | None = None
    """How far the atmosphere lies above the standard one in Pa; `None` where it does not."""

    def ambient(self, standard: Values) -> Values:
        """The atmosphere from which turbine pressure counts, in Pa absolute, of a law with that of a standard day."""
        return standard if self.ambient_shift is None else standard + self.ambient_shift


class Crank(Part):
    """Linkage between rod and vanes: crank angle in degrees, smallest with the vanes closed [3.14]."""

    ratio: Scalar = parameter(3120.0, symbol="psi", unit="deg/m", source="3.14", held=True)
    offset: Scalar = parameter(4.0, symbol="theta_offset", unit="deg", source="3.14", positive=False, held=True)

    def angle(self, opening: Values) -> Values:
        """Crank angle `C_r` in degrees at an opening in m, which is infinite of a rod without a closed stop."""
        placed = jnp.isfinite(opening)
        return jnp.where(placed, jnp.where(placed, opening, 0.0) * self.ratio + self.offset, opening)

    def opening(self, angle: Values) -> Values:
        """Opening in m at a crank angle in degrees, the inverse of `angle`."""
        return (angle - self.offset) / self.ratio


class HasCrank(eqx.Module):
    """A law over the angle of the crank, over which reports draw it."""

    crank: eqx.AbstractVar[Crank]
