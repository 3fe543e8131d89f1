"""The cold bench: no exhaust gas, no force."""

from typing import ClassVar

import jax.numpy as jnp

from ..._types import Values
from .._stateless import Stateless
from .._vanes import Vanes
from ._base import AbstractVaneForce


class NoVaneForce(Stateless, AbstractVaneForce):
    """Zero at every position and pressure, without a state."""

    feels_gas: ClassVar[bool] = False

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Zero."""
        return self.steady_force(vanes, velocity), None

    def steady_force(self, vanes: Vanes, velocity: Values) -> Values:
        """Zero."""
        return jnp.zeros_like(velocity)
