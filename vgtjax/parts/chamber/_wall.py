"""A chamber that exchanges heat with its wall."""

import equinox as eqx
import jax.numpy as jnp

from ..._errors import require_positive
from ..._types import Scalar, Values
from ...parameters import parameter
from .._air import Air
from .._converter import Flow
from ._adiabatic import adiabatic_rates
from ._base import AbstractChamber, GasState


class WallChamber(AbstractChamber):
    """Chamber into which flows the heat `Q = h A (T_wall - T)` that the thesis leaves out [2.43].

    Without conductance it is the adiabatic chamber; with a large one it is the isothermal chamber at the wall's
    temperature.
    """

    wall_conductance: Scalar = parameter(0.0, symbol="h A", unit="W/K", source="assumed", lower=0.0)
    wall_temperature: Scalar = parameter(293.15, symbol="T_wall", unit="K", source="assumed", held=True)
    fastest_exchange: float = eqx.field(static=True, default=3e3)
    """Highest rate in 1/s at which the gas takes on the temperature that flow and wall balance; a numerical setting."""

    def __check_init__(self) -> None:
        require_positive("fastest_exchange", self.fastest_exchange, "rate in 1/s", "use e.g. 3e3")

    def rates(self, air: Air, gas: GasState, inflow: Flow, displaced: Values, displacement_rate: Values) -> GasState:
        """Time derivatives of pressure (Pa/s) and temperature (K/s): [2.57] and the wall's heat."""
        shrinking = self.shrinking(displaced, displacement_rate)
        isolated = adiabatic_rates(air, gas, inflow, self.gas_volume(displaced), shrinking)
        exchange = self._exchange_rate(air, gas, displaced)
        warming = isolated.temperature + exchange * (self.wall_temperature - gas.temperature)
        warming = warming / jnp.maximum(exchange / self.fastest_exchange, 1.0)
        # At given mass and volume pressure goes with temperature; this is (gamma - 1) Q / V.
        heating = gas.pressure * (warming - isolated.temperature) / gas.temperature
        return GasState(isolated.pressure + heating, warming)

    def relaxation(self, air: Air, gas: GasState, displaced: Values) -> GasState:
        """Pressure is slow; temperature relaxes to that of the wall."""
        return GasState(None, jnp.minimum(self._exchange_rate(air, gas, displaced), self.fastest_exchange))

    def _exchange_rate(self, air: Air, gas: GasState, displaced: Values) -> Values:
        """`h A / (m c_v)` in 1/s, with `m c_v = p V / ((gamma - 1) T)`."""
        capacity = gas.pressure * self.gas_volume(displaced) / ((air.heat_capacity_ratio - 1) * gas.temperature)
        return self.wall_conductance / capacity
