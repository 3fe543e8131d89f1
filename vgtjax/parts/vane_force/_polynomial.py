"""The force-sensor polynomial [3.15]."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Scalar, Values
from ...parameters import parameter
from ...traces import STANDARD_ATMOSPHERE
from .._vanes import Crank, HasCrank, Vanes
from ._base import AbstractStatelessVaneForce

POWERS = (
    (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3),
    (4, 0), (3, 1), (2, 2), (1, 3), (5, 0), (4, 1), (3, 2), (2, 3),
)  # fmt: skip
"""Powers of crank angle and pressure ratio, term by term as printed."""
PRINTED = (
    191.0, 2.065, -408.3, -1.192, 14.65, 261.5, 0.0385, 0.7, -16.06, -47.88,
    -0.00029, -0.029, 0.162, 3.38, -7.78e-7, 2.25e-4, 2.29e-3, -0.057,
)  # fmt: skip


def _unit(angle: int, ratio: int) -> str:
    return "N" if angle == 0 else "N/deg" if angle == 1 else f"N/deg^{angle}"


class ForcePolynomial(AbstractStatelessVaneForce, HasCrank):
    """Polynomial in crank angle (deg) and pressure ratio across the turbine, `1 + p_trb / p_atm`; no state [3.15].

    Angle and ratio are held at the ends of `angle_range` and `ratio_range`, beyond which it makes no sense (erratum
    13).
    """

    equations: ClassVar[str] = "3.15"
    coefficients: Float[Array, " 18"] = parameter(
        PRINTED, symbol="a", unit=tuple(_unit(*power) for power in POWERS), source="3.15", positive=False
    )
    """In the order of `POWERS`."""
    ambient_pressure: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_atm", unit="Pa", source="B.2", held=True)
    """Pa absolute at the turbine's outlet, on a day with the standard atmosphere."""
    crank: Crank = eqx.field(default_factory=Crank)
    angle_range: tuple[float, float] = eqx.field(static=True, default=(4.0, 36.0))
    ratio_range: tuple[float, float] = eqx.field(static=True, default=(1.0, 3.0))

    def ratio(self, turbine_pressure: Values, ambient: Values | None = None) -> Values:
        """Pressure ratio across the turbine at an inlet pressure in Pa gauge; `ambient` in Pa absolute, that of a
        standard day where it is `None`."""
        return 1 + turbine_pressure / (self.ambient_pressure if ambient is None else ambient)

    def force(self, angle: Values, ratio: Values) -> Values:
        """Force in N at a crank angle in degrees and a pressure ratio, both held inside their ranges."""
        terms = polynomial_terms(jnp.clip(angle, *self.angle_range), jnp.clip(ratio, *self.ratio_range))
        return sum(self.coefficients[k] * term for k, term in enumerate(terms))

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Force in N, the same in both directions."""
        ratio = self.ratio(vanes.turbine_pressure, vanes.ambient(self.ambient_pressure))
        return self.force(self.crank.angle(vanes.opening), ratio), None


def polynomial_terms(angle: Values | np.ndarray, ratio: Values | np.ndarray) -> list:
    """The products of powers that [3.15] sums, at crank angles in degrees and pressure ratios."""
    return [angle**first * ratio**second for first, second in POWERS]
