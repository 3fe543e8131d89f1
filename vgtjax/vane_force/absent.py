"""The cold bench: no exhaust gas, no force."""

import jax.numpy as jnp

from ..air import Scalar
from .base import AbstractVaneForce


class NoVaneForce(AbstractVaneForce):
    """Zero at every position and pressure."""

    def __call__(self, position: Scalar, velocity: Scalar, turbine_pressure: Scalar) -> Scalar:
        """Zero."""
        return jnp.zeros_like(position)
