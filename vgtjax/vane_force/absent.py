"""The cold bench: no exhaust gas, no force."""

import jax.numpy as jnp
from jaxtyping import Array

from ..air import Scalar
from ..diaphragm import Body
from .base import AbstractVaneForce


class NoVaneForce(AbstractVaneForce):
    """Zero at every position and pressure, without a state."""

    def initial_state(self) -> None:
        """Nothing to remember."""

    def __call__(self, body: Body, travel: Scalar, state: None, turbine_pressure: Scalar) -> tuple[Scalar, None]:
        """Zero."""
        return jnp.zeros_like(body.position), None

    def relaxation(self, body: Body, state: None) -> None:
        """No state, no rate."""

    def signals(self, state: None) -> dict[str, Array]:
        """Nothing to show."""
        return {}

    def typical_state(self) -> None:
        """No state, no size."""
