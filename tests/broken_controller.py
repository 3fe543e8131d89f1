"""A controller that answers no number, which only a broken one would."""

import jax.numpy as jnp

from vgtjax.control import AbstractController


class Broken(AbstractController):
    """NaN after its first sample, whatever it measures."""

    def initial_state(self, measurement):
        return jnp.zeros_like(measurement.position)

    def update(self, state, measurement, reference, period):
        return state + 1, jnp.where(state > 0, jnp.nan, 0.0), {}
