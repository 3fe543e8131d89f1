"""What every model of the gas in the chamber answers."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar, StateLeaf, Values
from ...parameters import Part
from .._air import Air
from .._converter import Flow


class Gas(eqx.Module):
    """State of the gas in the chamber: pressure in Pa absolute and temperature in K."""

    pressure: StateLeaf
    temperature: StateLeaf


class AbstractChamber(Part):
    """Gas in the volume that the diaphragm leaves; mass is an output, `p V / (R T)`, never a state of its own."""

    place: ClassVar[str] = "chamber"

    volume: eqx.AbstractVar[Scalar]
    """Volume in m3 with the diaphragm at its open stop."""

    def gas_volume(self, displaced: Values) -> Values:
        """Volume of the gas in m3 when the diaphragm has displaced `displaced` m3 [2.41].

        A diaphragm that has swallowed its chamber is a failed simulation, not a negative volume: then it is NaN.
        """
        volume = self.volume - displaced
        return jnp.where(volume > 0, volume, jnp.nan)

    @abc.abstractmethod
    def rates(self, air: Air, gas: Gas, inflow: Flow, displaced: Values, displacement_rate: Values) -> Gas:
        """Time derivatives of pressure (Pa/s) and temperature (K/s).

        **Arguments:** `displaced` in m3 and `displacement_rate` in m3/s, the volume swept by the diaphragm.
        """

    @abc.abstractmethod
    def relaxation(self, air: Air, gas: Gas, displaced: Values) -> Gas:
        """Relaxation rates in 1/s of pressure and temperature, `None` where they are slow."""
