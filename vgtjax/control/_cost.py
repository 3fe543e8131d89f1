"""Figures of merit of a closed loop, from `settled` seconds on; each a scalar with derivatives."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._types import Scalar
from ._loop import ClosedLoop


def tracking_rms(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square of reference minus true position in m."""
    return jnp.sqrt(_mean(jnp.square(run.error), run.time >= settled))


def tracking_peak(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Largest distance between reference and true position in m."""
    return jnp.max(jnp.where(run.time >= settled, jnp.abs(run.error), 0.0))


def effort(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square of the duty in percent."""
    return jnp.sqrt(_mean(jnp.square(run.duty), run.time >= settled))


def chatter(run: ClosedLoop, settled: float = 0.0) -> Scalar:
    """Root mean square change of the duty from one sample to the next in percent."""
    return jnp.sqrt(_mean(jnp.square(jnp.diff(run.duty)), run.time[1:] >= settled))


def _mean(values: Array, counted: Bool[Array, " time"]) -> Scalar:
    return jnp.sum(jnp.where(counted, values, 0.0)) / jnp.maximum(jnp.sum(counted), 1)
