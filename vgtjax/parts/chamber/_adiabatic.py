"""A chamber without heat exchange [2.39-2.57]."""

from ..._types import Values
from .._air import Air
from .._converter import Flow
from ._base import AbstractChamber, GasState


def adiabatic_rates(air: Air, gas: GasState, inflow: Flow, volume: Values, displacement_rate: Values) -> GasState:
    """Time derivatives of pressure (Pa/s) and temperature (K/s) without heat exchange.

    [2.57] with the volume term `+ gamma p A_d v / V` (erratum), and `T' = T (p'/p + V'/V - m'/m)` with
    `m = p V / (R T)`; the two are written over the common denominators `V` and `p V`.

    **Arguments:** `volume` of the gas in m3, which the diaphragm takes at `displacement_rate` in m3/s.
    """
    gamma = air.heat_capacity_ratio
    heat = air.gas_constant * inflow.temperature * inflow.mass_flow
    work = -gas.pressure * displacement_rate
    leaving = air.gas_constant * gas.temperature * inflow.mass_flow
    pressure_rate = gamma * (heat - work) / volume
    temperature_rate = gas.temperature * (gamma * heat - (gamma - 1) * work - leaving) / (gas.pressure * volume)
    return GasState(pressure_rate, temperature_rate)


class AdiabaticChamber(AbstractChamber):
    """Chamber without heat exchange."""

    def rates(self, air: Air, gas: GasState, inflow: Flow, displaced: Values, displacement_rate: Values) -> GasState:
        """Time derivatives of pressure (Pa/s) and temperature (K/s) [2.57]."""
        shrinking = self.shrinking(displaced, displacement_rate)
        return adiabatic_rates(air, gas, inflow, self.gas_volume(displaced), shrinking)

    def relaxation(self, air: Air, gas: GasState, displaced: Values) -> GasState:
        """The gas is slow."""
        return GasState(None, None)
