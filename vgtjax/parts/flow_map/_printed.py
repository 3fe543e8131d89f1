"""The flow map that the thesis prints [B.4]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._types import Scalar, Values
from ...parameters import parameter
from ...traces import STANDARD_ATMOSPHERE
from ._base import FULL_DUTY, AbstractFlowMap, duty_by_bisection, equilibrium_pressure
from ._roots import polynomial, slope

MBAR = 100.0
"""Pa."""


class PrintedFlow(AbstractFlowMap):
    """`f = phi(dp) + psi(dp) u` [B.4] with `dp = p - p_eq(u)` in mbar and `u` as a fraction from 0 to 1 (erratum).

    As printed, with its faults, of which the manual's page on physics tells. The default `p_eq(u)` [2.8, B.1] is that
    at 20 kPa of reservoir pressure.
    """

    phi: Float[Array, " 6"] = parameter(
        (-7.94e-6, -4.92e-7, -5.94e-10, -2.48e-12, 5.65e-15, 1.59e-18),
        symbol="phi",
        unit=tuple(f"kg/(s mbar^{k})" for k in range(6)),
        source="B.4",
        positive=False,
        held=True,
    )
    psi: Float[Array, " 5"] = parameter(
        (5.19e-7, -5.27e-8, 3.13e-10, -1.13e-13, -4.42e-16),
        symbol="psi",
        unit=tuple(f"kg/(s mbar^{k})" for k in range(5)),
        source="B.4",
        positive=False,
        held=True,
    )
    equilibrium: Float[Array, " 5"] = equilibrium_pressure()
    ambient: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_map", unit="Pa", source="B.2", held=True)
    difference_range: tuple[float, float] = eqx.field(static=True, default=(-720.0, 440.0))
    """mbar; none is printed. Within it flow falls with pressure, and with duty from 1 % upwards."""

    def equilibrium_pressure(self, duty: Values) -> Values:
        """`p_eq` in Pa absolute at the atmosphere of the map."""
        return polynomial(self.equilibrium, duty)

    def __call__(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s [B.4]."""
        duty = jnp.clip(duty, 0.0, FULL_DUTY)
        share = duty / FULL_DUTY
        difference = self._difference(duty, pressure, ambient)
        within = jnp.clip(difference, *self.difference_range)
        value = polynomial(self.phi, within) + polynomial(self.psi, within) * share
        along = slope(self.phi, within) + slope(self.psi, within) * share
        return value + along * (difference - within)

    def valid(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Bool[Array, "..."]:
        """Whether the pressure is near enough to that of equilibrium."""
        low, high = self.difference_range
        difference = self._difference(duty, pressure, ambient)
        return (duty >= 0) & (duty <= FULL_DUTY) & (difference >= low) & (difference <= high)

    def duty_for(self, flow: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """By bisection."""
        return duty_by_bisection(self, flow, pressure, ambient)

    def _difference(self, duty: Values, pressure: Values, ambient: Values | None) -> Values:
        return (pressure - self.gauge_shift(ambient) - self.equilibrium_pressure(duty)) / MBAR
