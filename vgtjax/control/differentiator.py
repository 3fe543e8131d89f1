"""Velocity from sampled positions."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..air import Scalar
from ..parameters import parameter
from .base import Memory


class AbstractDifferentiator(eqx.Module):
    """Estimates the derivative of a sampled signal."""

    @abc.abstractmethod
    def initial_state(self, value: Scalar) -> Memory:
        """What it remembers before the first sample, which is given and at rest."""

    @abc.abstractmethod
    def update(self, state: Any, value: Scalar, period: float) -> tuple[Memory, Scalar]:
        """One sample: what it remembers next, and the derivative a second."""


class FilteredSlope(eqx.Module):
    """Last value, and its filtered derivative a second."""

    value: Scalar
    slope: Scalar


class FilteredDifference(AbstractDifferentiator):
    """`s / (filter_time s + 1)` by backward differences."""

    filter_time: Scalar = parameter(5e-3, symbol="T_f", unit="s", source="assumed", assumed=True)

    def initial_state(self, value: Scalar) -> FilteredSlope:
        """See the base class."""
        return FilteredSlope(value, jnp.zeros_like(value))

    def update(self, state: FilteredSlope, value: Scalar, period: float) -> tuple[FilteredSlope, Scalar]:
        """See the base class."""
        slope = (self.filter_time * state.slope + (value - state.value)) / (self.filter_time + period)
        return FilteredSlope(value, slope), slope


class LevantDifferentiator(AbstractDifferentiator):
    """Robust exact differentiator of first order (Levant, 1998), one explicit Euler step a sample.

    `z0' = z1 - 1.5 sqrt(L) |s|^(1/2) sign(s)`, `z1' = -1.1 L sign(s)`, `s = z0 - value`, `L` the largest second
    derivative. Sign and root are those of `s` over `|s| + width`: far below the noise, `width` only keeps the
    derivatives finite; at or above it, this is the smooth relative, linear inside.
    """

    largest_second_derivative: Scalar = parameter(5.0, symbol="L", unit="m/s2", source="assumed", assumed=True)
    width: Scalar = parameter(1e-9, symbol="w", unit="m", source="assumed", assumed=True, held=True)

    def initial_state(self, value: Scalar) -> FilteredSlope:
        """See the base class."""
        return FilteredSlope(value, jnp.zeros_like(value))

    def update(self, state: FilteredSlope, value: Scalar, period: float) -> tuple[FilteredSlope, Scalar]:
        """See the base class."""
        bound = self.largest_second_derivative
        apart = state.value - value
        softened = jnp.abs(apart) + self.width
        rate = state.slope - 1.5 * jnp.sqrt(bound / softened) * apart
        slope = state.slope - period * 1.1 * bound * apart / softened
        return FilteredSlope(state.value + period * rate, slope), slope
