"""A chamber whose gas stays at ambient temperature [3.13, 5.2]."""

from typing import ClassVar

import jax.numpy as jnp

from ..._types import Values
from .._air import Air
from .._converter import Flow
from ._base import AbstractChamber, GasState


class IsothermalChamber(AbstractChamber):
    """Chamber that exchanges all heat at once; it must start at ambient temperature."""

    has_temperature: ClassVar[bool] = False

    def rates(self, air: Air, gas: GasState, inflow: Flow, displaced: Values, displacement_rate: Values) -> GasState:
        """Time derivatives of pressure (Pa/s) and temperature (zero).

        `p' = (R T_atm m' + p A_d v) / V` [5.2]. [3.13] has inflow and outflow swapped (erratum), and its equation
        carries no gamma: that belongs to the adiabatic chamber.
        """
        flow = air.gas_constant * air.temperature * inflow.mass_flow
        shrinking = self.shrinking(displaced, displacement_rate)
        pressure_rate = (flow + gas.pressure * shrinking) / self.gas_volume(displaced)
        return GasState(pressure_rate, jnp.zeros_like(gas.temperature))

    def relaxation(self, air: Air, gas: GasState, displaced: Values) -> GasState:
        """The gas is slow."""
        return GasState(None, None)
