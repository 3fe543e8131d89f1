"""By how much a rod whose duty saturates stays behind the velocity of its reference."""

import jax.numpy as jnp

from .._types import Scalar
from ._base import FULL_DUTY, Reference

NEAR_LIMIT = 5.0
"""%; the duty's distance from a limit within which the rod counts as following the reference the less."""


def following(duty: Scalar) -> Scalar:
    """From 1, where the last duty in percent leaves room, to 0 at its limits."""
    return jnp.clip(jnp.minimum(duty, FULL_DUTY - duty) / NEAR_LIMIT, 0.0, 1.0)


def velocity_lag(lag: Scalar, follows: Scalar, reference: Reference, period: float) -> Scalar:
    """The lag in m/s one sample later, between none and the whole velocity of the reference.

    It grows by what the reference accelerates while the rod follows less than wholly. A reference that rests leaves
    none, so that nothing stays behind, whatever was missed before.
    """
    missed = lag + period * (1 - follows) * reference.acceleration
    return jnp.clip(missed, jnp.minimum(reference.velocity, 0.0), jnp.maximum(reference.velocity, 0.0))
