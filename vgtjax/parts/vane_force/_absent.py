"""The cold bench: no exhaust gas, no force."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from ..._types import Values
from .._vanes import Vanes
from ._base import AbstractVaneForce


class NoVaneForce(AbstractVaneForce):
    """Zero at every position and pressure, without a state."""

    feels_gas: ClassVar[bool] = False

    def initial_state(self) -> None:
        """Nothing to remember."""

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Zero."""
        return jnp.zeros_like(velocity), None

    def relaxation(self, vanes: Vanes, velocity: Values, state: None) -> None:
        """No state, no rate."""

    def signals(self, vanes: Vanes, velocity: Values, state: None) -> dict[str, Array]:
        """Nothing to show."""
        return {}

    def typical_state(self) -> None:
        """No state, no size."""
