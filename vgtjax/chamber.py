"""The diaphragm chamber: ideal gas in a moving volume [2.39-2.57]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .air import Air, Scalar
from .converter import Flow
from .parameters import parameter


class Gas(eqx.Module):
    """State of the gas in the chamber: pressure in Pa absolute and temperature in K."""

    pressure: Scalar
    temperature: Scalar


class AdiabaticChamber(eqx.Module):
    """Chamber without heat exchange."""

    volume: Scalar = parameter(60e-6, symbol="V_0", unit="m3", source="B.2")

    def gas_volume(self, displaced: Float[Array, "..."]) -> Float[Array, "..."]:
        """Volume of the gas in m3 when the diaphragm has displaced `displaced` m3."""
        return self.volume - displaced

    def rates(self, air: Air, gas: Gas, inflow: Flow, displaced: Scalar, displacement_rate: Scalar) -> Gas:
        """Time derivatives of pressure (Pa/s) and temperature (K/s).

        [2.57] with the volume term `+ gamma p A_d v / V` (erratum 3), and `T' = T (p'/p + V'/V - m'/m)` with
        `m = p V / (R T)`; the two are written over the common denominators `V` and `p V`.

        **Arguments:** `displaced` in m3 and `displacement_rate` in m3/s, the volume swept by the diaphragm.
        """
        gamma = air.heat_capacity_ratio
        volume = self.gas_volume(displaced)
        # A diaphragm that has swallowed its chamber is a failed simulation, not a negative volume.
        volume = jnp.where(volume > 0, volume, jnp.nan)
        heat = air.gas_constant * inflow.temperature * inflow.mass_flow
        work = -gas.pressure * displacement_rate
        leaving = air.gas_constant * gas.temperature * inflow.mass_flow
        pressure_rate = gamma * (heat - work) / volume
        temperature_rate = gas.temperature * (gamma * heat - (gamma - 1) * work - leaving) / (gas.pressure * volume)
        return Gas(pressure_rate, temperature_rate)
