"""Magnetic force as a static function of the duty [2.9, B.1]."""

from typing import ClassVar

from jaxtyping import Array, Float

from ..._types import Values
from ...parameters import parameter
from .._stateless import Stateless
from ._base import AbstractMagneticForce


class StaticForce(Stateless, AbstractMagneticForce):
    """Quartic in the duty, whatever the plunger's position, without a state."""

    coefficients: Float[Array, " 5"] = parameter(
        (0.021731, 0.0022634, 0.0039, -3.5733e-5, 9.1355e-8),
        symbol="c",
        unit=("N", "N/%", "N/%^2", "N/%^3", "N/%^4"),
        source="B.1",
        positive=False,
        anonymous=True,
    )
    """`c0..c4`."""

    rest_iterations: ClassVar[int] = 1

    def __call__(self, pwm: Values, position: Values, velocity: Values, state: None) -> tuple[Values, None]:
        """The quartic."""
        return self.steady_pull(pwm, position), None

    def steady_pull(self, pwm: Values, position: Values) -> Values:
        """The quartic [2.9 with the digits of B.1]."""
        c0, c1, c2, c3, c4 = (self.coefficients[k] for k in range(5))
        return (((c4 * pwm + c3) * pwm + c2) * pwm + c1) * pwm + c0
