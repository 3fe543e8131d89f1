"""What every model of the gas in the chamber answers."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar, StateLeaf, Values
from ...parameters import Part, parameter
from .._air import Air
from .._converter import Flow

DEAD_VOLUME = 6e-7
"""m3 that no diaphragm displaces, a hundredth of the printed chamber; from twice that on, nothing of it is felt."""
THIN_VOLUME = 6e-6
"""m3 below which gas may be too stiff a spring for the default step."""


class GasState(eqx.Module):
    """State of the gas in the chamber: pressure in Pa absolute and temperature in K."""

    pressure: StateLeaf
    temperature: StateLeaf


class AbstractChamber(Part):
    """Gas in the volume that the diaphragm leaves; mass is an output, `p V / (R T)`, never a state of its own."""

    place: ClassVar[str] = "chamber"
    has_temperature: ClassVar[bool] = True
    """Whether its gas has a temperature of its own, and not that around it."""

    volume: Scalar = parameter(60e-6, symbol="V_0", unit="m3", source="B.2")
    """Volume in m3 with the diaphragm at its open stop."""

    def gas_volume(self, displaced: Values) -> Values:
        """Volume of the gas in m3 when the diaphragm has displaced `displaced` m3 [2.41], and never less than
        `DEAD_VOLUME`.

        A stop gives, and a diaphragm that comes to the chamber's bottom lies against it. One that sweeps twice its
        chamber is a failed simulation: then it is NaN.
        """
        volume = self.volume - displaced
        squeezed = jnp.where(volume > -self.volume, DEAD_VOLUME * (1 + self._moving_share(displaced) ** 2), jnp.nan)
        return jnp.where(volume > 2 * DEAD_VOLUME, volume, squeezed)

    def shrinking(self, displaced: Values, swept: Values) -> Values:
        """Rate in m3/s at which the volume of the gas shrinks while the diaphragm sweeps `swept` m3/s."""
        return swept * self._moving_share(displaced)

    def thinness(self, displaced: Values) -> Values:
        """Zero where the gas has `THIN_VOLUME` or more; one where it has nothing left."""
        return jnp.maximum(1 - (self.volume - displaced) * (1 / THIN_VOLUME), 0.0)

    def _moving_share(self, displaced: Values) -> Values:
        """How much of the diaphragm still moves: one, and zero where it lies against the bottom; the slope of
        `gas_volume`."""
        return jnp.clip((self.volume - displaced) * (0.5 / DEAD_VOLUME), 0.0, 1.0)

    @abc.abstractmethod
    def rates(self, air: Air, gas: GasState, inflow: Flow, displaced: Values, displacement_rate: Values) -> GasState:
        """Time derivatives of pressure (Pa/s) and temperature (K/s).

        **Arguments:** `displaced` in m3 and `displacement_rate` in m3/s, the volume swept by the diaphragm.
        """

    @abc.abstractmethod
    def relaxation(self, air: Air, gas: GasState, displaced: Values) -> GasState:
        """Relaxation rates in 1/s of pressure and temperature, `None` where they are slow."""
