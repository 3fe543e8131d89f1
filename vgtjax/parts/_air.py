"""Air: ideal gas at the ambient state, and compressible flow of a gas through an orifice [2.13-2.15, A.29]."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._types import Scalar, Values
from ..parameters import Part, parameter
from ..traces import STANDARD_ATMOSPHERE
from ._logarithm import log_of_ratio


class AbstractIdealGas(Part):
    """An ideal gas with constant heat capacities, as far as an orifice feels it."""

    gas_constant: eqx.AbstractVar[Scalar]
    """R in J/(kg K)."""
    heat_capacity_ratio: eqx.AbstractVar[Scalar]
    """gamma."""
    linear_above: eqx.AbstractVar[float]
    """Pressure ratio above which the flow function is a straight line to zero; a numerical setting."""

    def critical_ratio(self) -> Values:
        """Pressure ratio below which the flow is choked, `(2/(gamma+1))^(gamma/(gamma-1))` [2.15]."""
        gamma = self.heat_capacity_ratio
        return jnp.exp(gamma / (gamma - 1) * jnp.log(2 / (gamma + 1)))


class Air(AbstractIdealGas):
    """Properties of air and of the atmosphere around the actuator (Table B.2)."""

    place: ClassVar[str] = "air"

    gas_constant: Scalar = parameter(286.7, symbol="R", unit="J/(kg K)", source="B.2", held=True)
    heat_capacity_ratio: Scalar = parameter(1.396, symbol="gamma", unit="1", source="B.2", held=True, above=1.0)
    pressure: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_atm", unit="Pa", source="B.2", held=True)
    temperature: Scalar = parameter(293.15, symbol="T_atm", unit="K", source="assumed", held=True)
    linear_above: float = eqx.field(static=True, default=0.9999)


def _choked_or_smooth(gas: AbstractIdealGas, ratio: Values) -> Values:
    """`Phi^2` [2.15], held constant below the critical ratio and above `linear_above`."""
    clipped = jnp.clip(ratio, gas.critical_ratio(), gas.linear_above)
    root = jnp.exp(log_of_ratio(clipped) / gas.heat_capacity_ratio)
    return 2 / (gas.heat_capacity_ratio - 1) * root * (root - clipped)


def _chord(gas: AbstractIdealGas, ratio: Values) -> Values:
    """One up to `linear_above`, then straight to zero at equal pressures."""
    return jnp.minimum((1 - ratio) * (1 / (1 - gas.linear_above)), 1.0)


def flow_function(gas: AbstractIdealGas, ratio: Values) -> Values:
    """`Phi(p_down / p_up)` [2.15, with `2/(gamma-1)` under the root], dimensionless: constant when choked, above
    `linear_above` the chord to zero, as its slope is infinite at equal pressures."""
    return jnp.sqrt(_choked_or_smooth(gas, ratio)) * _chord(gas, ratio)


def flow_between(
    gas: AbstractIdealGas,
    area: Values,
    source_pressure: Values,
    source_temperature: Values,
    pressure: Values,
    temperature: Values,
    conductance: Values | None = None,
) -> tuple[Values, Values]:
    """Mass flow from one volume through an orifice into another [2.13-2.14, A.29], either way.

    Upstream is whichever pressure is larger. Gas carries the temperature of the volume that it leaves.

    **Arguments:** `area` in m2; pressure in Pa absolute and temperature in K of the source, then of the other volume;
    `conductance` in kg/(s Pa), the most that flows for each Pa between them, without a limit if absent.

    **Returns:** mass flow out of the source in kg/s, and the temperature of the gas that flows in K.
    """
    entering = source_pressure > pressure
    # Not maximum and minimum: at equal pressures, where a vented chamber rests, their derivatives split the tie and the
    # flow would not feel either pressure.
    upstream = jnp.where(entering, source_pressure, pressure)
    ratio = jnp.where(entering, pressure, source_pressure) / upstream
    gas_temperature = jnp.where(entering, source_temperature, temperature)
    # sqrt(gamma / (R T)) and Phi under a single root: roots and divisions are what this costs.
    scale = gas.heat_capacity_ratio / gas.gas_constant
    speed = jnp.sqrt(scale * _choked_or_smooth(gas, ratio) / gas_temperature)
    passed = area * speed
    if conductance is not None:
        # Where the chord falls to zero it takes the limit with it, so that neither is zero at equal pressures alone.
        passed = jnp.minimum(passed, conductance * jnp.maximum(1 - ratio, 1 - gas.linear_above))
    return jnp.where(entering, passed, -passed) * upstream * _chord(gas, ratio), gas_temperature


def orifice_flow(
    air: Air,
    area: Values,
    source_pressure: Values,
    pressure: Values,
    temperature: Values,
    conductance: Values | None = None,
) -> tuple[Values, Values]:
    """Mass flow from a source of ambient air through an orifice into a volume, either way; see [`flow_between`][].

    **Arguments:** `area` in m2, both pressures in Pa absolute, `temperature` of the volume in K; `conductance` in
    kg/(s Pa), the most that flows for each Pa between them, without a limit if absent.

    **Returns:** mass flow into the volume in kg/s, and the temperature of the gas that flows in K.
    """
    return flow_between(air, area, source_pressure, air.temperature, pressure, temperature, conductance)
