"""The exhaust valves of one cylinder."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import Part, parameter

CYCLE = 720.0
"""deg of crank angle in a cycle of four strokes."""


class Valve(Part):
    """Poppet valves that open together, with a lift of `sin^2` between opening and closing.

    They are narrowest at the curtain below the disc or at the seat; the smooth sum of both takes the place of the
    smaller one.
    """

    place: ClassVar[str] = "valve"

    opening: Scalar = parameter(140.0, symbol="EVO", unit="deg", source="assumed", held=True)
    closing: Scalar = parameter(370.0, symbol="EVC", unit="deg", source="assumed", held=True)
    diameter: Scalar = parameter(22e-3, symbol="D", unit="m", source="assumed", held=True)
    lift: Scalar = parameter(8.5e-3, symbol="L", unit="m", source="assumed", held=True)
    discharge: Scalar = parameter(0.65, symbol="C_d", unit="1", source="assumed")
    number: int = eqx.field(static=True, default=2)
    """Exhaust valves of a cylinder, assumed."""

    def __check_init__(self) -> None:
        if self.number < 1:
            raise InputError(f"a cylinder must have an exhaust valve, but it has {self.number}; give e.g. 2")
        require_positive("valve.diameter", self.diameter, "number of metres", "use e.g. 0.022")
        if is_traced(self.opening, self.closing):
            return
        opens, closes = float(jnp.min(self.opening)), float(jnp.max(self.closing))
        if not bool(jnp.all(self.opening < self.closing)):
            raise InputError(
                f"an exhaust valve must open before it closes, but it opens at {opens:g} deg and closes at {closes:g} "
                "deg; correct valve.opening or valve.closing"
            )
        if not closes < CYCLE:
            raise InputError(
                f"an exhaust valve must close before the next firing, but it does so at {closes:g} deg after the last; "
                "correct valve.closing"
            )

    def area(self, angle: Values) -> Values:
        """Effective area in m2 of all valves of the cylinder, at a crank angle in deg after its firing TDC."""
        share = jnp.clip((angle - self.opening) / (self.closing - self.opening), 0.0, 1.0)
        curtain = jnp.pi * self.diameter * self.lift * jnp.sin(jnp.pi * share) ** 2
        seat = jnp.pi / 4 * self.diameter**2
        return self.number * self.discharge * curtain * seat / jnp.sqrt(curtain**2 + seat**2)
