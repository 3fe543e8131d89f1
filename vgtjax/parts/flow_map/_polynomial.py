"""The flow map of the controllers: a polynomial in pressure plus one in duty [5.10]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._types import Scalar, Values
from ...parameters import parameter
from ...traces import STANDARD_ATMOSPHERE
from ._base import FULL_DUTY, AbstractFlowMap
from ._roots import polynomial, slope


class PolynomialFlow(AbstractFlowMap):
    """`f = a0 + a1 p + a2 p^2 + b1 u + b2 u^2` [5.10], `u` in percent and `p` in Pa absolute.

    The coefficients are not printed: the defaults are fitted to the full actuator with printed parameters, by
    [`fit_flow_map`][] with kind `"polynomial"`.
    """

    pressure: Float[Array, " 3"] = parameter(
        (5.175494589e-4, -3.946716821e-9, -9.141564538e-15),
        symbol="a",
        unit=("kg/s", "kg/(s Pa)", "kg/(s Pa^2)"),
        source="fitted",
        positive=False,
        held=True,
    )
    duty: Float[Array, " 2"] = parameter(
        (-4.546989904e-6, 5.144813428e-9),
        symbol="b",
        unit=("kg/(s %)", "kg/(s %^2)"),
        source="fitted",
        positive=False,
        held=True,
    )
    """`b1, b2`."""
    ambient: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_map", unit="Pa", source="B.2", held=True)
    pressure_range: tuple[float, float] = eqx.field(static=True, default=(29368.2, STANDARD_ATMOSPHERE))
    """Pa absolute; where it was fitted."""

    def __call__(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s [5.10]."""
        duty = jnp.clip(duty, 0.0, FULL_DUTY)
        b1, b2 = self.duty[0], self.duty[1]
        return self._without_duty(pressure, ambient) + (b1 + b2 * duty) * duty

    def valid(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Bool[Array, "..."]:
        """Whether duty and pressure lie where it was fitted."""
        inside = pressure - self.gauge_shift(ambient)
        low, high = self.pressure_range
        return (duty >= 0) & (duty <= FULL_DUTY) & (inside >= low) & (inside <= high)

    def duty_for(self, flow: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """The root `u = -2 q / (-b1 + sqrt(b1^2 + 4 b2 q))` with `q = f - a0 - a1 p - a2 p^2`, clipped.

        It lies on the branch with `df/du = b1 + 2 b2 u < 0`, and is exact for `b2 -> 0` too. The print takes the other
        branch after (5.35) (erratum).
        """
        b1, b2 = self.duty[0], self.duty[1]
        missing = flow - self._without_duty(pressure, ambient)
        square = b1**2 + 4 * b2 * missing
        real = square > 0
        root = jnp.where(real, jnp.sqrt(jnp.where(real, square, 1.0)), 0.0)
        return jnp.clip(-2 * missing / (root - b1), 0.0, FULL_DUTY)

    def _without_duty(self, pressure: Values, ambient: Values | None) -> Values:
        gauged = pressure - self.gauge_shift(ambient)
        within = jnp.clip(gauged, *self.pressure_range)
        return polynomial(self.pressure, within) + slope(self.pressure, within) * (gauged - within)
