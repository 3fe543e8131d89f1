"""The exhaust gas: calorically perfect."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import Part, parameter

GAS_CONSTANT = 287.0
"""J/(kg K), of a Diesel engine's burnt gas: assumed."""
GAS_GAMMA = 1.34
"""Ratio of its heat capacities at some 900 K: assumed."""


class Gas(Part):
    """A calorically perfect gas [3.38-3.41].

    **Raises:** `InputError` for a gas without a constant, or with a ratio of heat capacities that is not above 1.
    """

    gamma: Scalar = parameter(GAS_GAMMA, symbol="gamma", unit="-", source="exhaust gas at 900 K, assumed", held=True)
    """Ratio of the heat capacities."""
    constant: Scalar = parameter(GAS_CONSTANT, symbol="r", unit="J/(kg K)", source="3.40, value assumed", held=True)
    """Specific gas constant; the print calls it the universal one (erratum E6)."""

    def __check_init__(self) -> None:
        self.require_working()

    def require_working(self) -> None:
        """**Raises:** `InputError` as above, for values that were put in later as well."""
        require_positive(
            "gas.constant", self.constant, "specific gas constant in J/(kg K)", "287 is that of exhaust gas"
        )
        if not is_traced(self.gamma) and not np.all((np.asarray(self.gamma) > 1) & np.isfinite(self.gamma)):
            raise InputError(
                f"gas.gamma must be a ratio of heat capacities above 1, but it is {self.gamma}; correct it"
            )

    def works(self) -> Bool[Array, "..."]:
        """Whether it is one, also where it is traced; `require_working` says why not."""
        return (self.constant > 0) & (self.gamma > 1)

    @property
    def heat_capacity(self) -> Values:
        """At constant pressure, in J/(kg K)."""
        return self.gamma * self.constant / (self.gamma - 1)

    def sound_speed(self, temperature: Values) -> Values:
        """In m/s at a temperature in K."""
        return jnp.sqrt(self.gamma * self.constant * temperature)

    def expanded_temperature(self, temperature: Values, pressure_ratio: Values) -> Values:
        """In K after a change of pressure by a ratio (end over begin) without loss."""
        return temperature * pressure_ratio ** ((self.gamma - 1) / self.gamma)

    def expanded_pressure(self, pressure: Values, temperature_ratio: Values) -> Values:
        """In Pa after a change of temperature by a ratio (end over begin) without loss."""
        return pressure * temperature_ratio ** (self.gamma / (self.gamma - 1))
