"""Velocity from sampled positions."""

import abc

import equinox as eqx
import jax.numpy as jnp

from ..._types import OwnState, Scalar
from ...parameters import parameter
from .._base import Memory
from .._design import AbstractDesign


class AbstractDifferentiator(AbstractDesign):
    """Estimates the derivative of a sampled signal."""

    @abc.abstractmethod
    def initial_state(self, value: Scalar) -> Memory:
        """What it remembers before the first sample, which is given and at rest."""

    @abc.abstractmethod
    def update(self, state: OwnState, value: Scalar, period: float, expected: Scalar = 0.0) -> tuple[Memory, Scalar]:
        """One sample: what it remembers next, and the derivative per second.

        `expected` is the derivative at the sample as far as it is known beforehand, that of a reference for instance:
        only what differs from it has to be found from the samples, and lags or is bounded.
        """

    @abc.abstractmethod
    def value(self, state: OwnState, period: float, expected: Scalar = 0.0) -> Scalar:
        """The signal itself at the last sample, as smooth as the estimate has it; `expected` as there."""


class FilteredSlope(eqx.Module):
    """Last value, and by how much its filtered derivative per second exceeds the one that was expected.

    The excess, not the derivative: however an expected derivative jumps or is missed between two samples, none of it
    stays behind.
    """

    value: Scalar
    slope: Scalar


class FilteredDifference(AbstractDifferentiator):
    """`s / (filter_time s + 1)` by backward differences."""

    filter_time: Scalar = parameter(5e-3, symbol="T_f", unit="s", source="assumed")

    def initial_state(self, value: Scalar) -> FilteredSlope:
        """See the base class."""
        return FilteredSlope(value, jnp.zeros_like(value))

    def update(
        self, state: FilteredSlope, value: Scalar, period: float, expected: Scalar = 0.0
    ) -> tuple[FilteredSlope, Scalar]:
        """See the base class."""
        change = value - state.value - period * expected
        slope = (self.filter_time * state.slope + change) / (self.filter_time + period)
        return FilteredSlope(value, slope), slope + expected

    def value(self, state: FilteredSlope, period: float, expected: Scalar = 0.0) -> Scalar:
        """The last sample, unfiltered."""
        return state.value


class LevantDifferentiator(AbstractDifferentiator):
    """Robust exact differentiator of first order (Levant, 1998), one explicit Euler step a sample.

    `z0' = expected + z1 - 1.5 sqrt(L) |s|^(1/2) sign(s)`, `z1' = -1.1 L sign(s)`, `s = z0 - value`, `L` the largest
    second derivative but for that of the expected one; the derivative is `expected + z1`. Sign and root are those of
    `s` over `|s| + width`: far below the noise, `width` only keeps the derivatives finite; at or above it, this is the
    smooth relative, linear inside, where it filters with `sqrt(1.1 L / width)` in rad/s.
    """

    largest_second_derivative: Scalar = parameter(5.0, symbol="L", unit="m/s2", source="assumed")
    # Tuned above the noise of the sensors, so that its sign is not tossed by it.
    width: Scalar = parameter(1e-9, symbol="w", unit="m", source="assumed", held=True, above=0.0, tuning_width=3e-5)

    def initial_state(self, value: Scalar) -> FilteredSlope:
        """See the base class."""
        return FilteredSlope(value, jnp.zeros_like(value))

    def update(
        self, state: FilteredSlope, value: Scalar, period: float, expected: Scalar = 0.0
    ) -> tuple[FilteredSlope, Scalar]:
        """See the base class."""
        bound = self.largest_second_derivative
        apart = state.value - value
        softened = jnp.abs(apart) + self.width
        rate = expected + state.slope - 1.5 * jnp.sqrt(bound / softened) * apart
        slope = state.slope - period * 1.1 * bound * apart / softened
        return FilteredSlope(state.value + period * rate, slope), slope + expected

    def value(self, state: FilteredSlope, period: float, expected: Scalar = 0.0) -> Scalar:
        """`z0`, which an Euler step has brought to the next sample, less that step."""
        return state.value - period * (state.slope + expected)


class ImplicitLevantDifferentiator(AbstractDifferentiator):
    """Levant's differentiator of first order, one implicit Euler step a sample (Acary and Brogliato, 2010).

    The equations of [`LevantDifferentiator`][], with sign and root of the `s` that the step leads to, and no width.
    Where the sign can make `s` zero it takes the value within -1 and 1 that does: nothing chatters, whatever the
    period. Noise reaches the slope by some `sqrt(2 L noise)`.
    """

    largest_second_derivative: Scalar = parameter(0.05, symbol="L", unit="m/s2", source="assumed", above=0.0)

    def initial_state(self, value: Scalar) -> FilteredSlope:
        """See the base class."""
        return FilteredSlope(value, jnp.zeros_like(value))

    def update(
        self, state: FilteredSlope, value: Scalar, period: float, expected: Scalar = 0.0
    ) -> tuple[FilteredSlope, Scalar]:
        """See the base class."""
        bound = self.largest_second_derivative
        ahead = state.value + period * (state.slope + expected) - value
        linear, switched = 1.5 * period * jnp.sqrt(bound), 1.1 * period**2 * bound
        # s + linear sqrt|s| sign(s) + switched sign(s) = ahead; the second form of the root, which does not cancel.
        beyond = jnp.maximum(jnp.abs(ahead) - switched, 0.0)
        root = 2 * beyond / (linear + jnp.sqrt(linear**2 + 4 * beyond))
        sign = jnp.clip(ahead / switched, -1.0, 1.0)
        slope = state.slope - period * 1.1 * bound * sign
        return FilteredSlope(value + root**2 * sign, slope), slope + expected

    def value(self, state: FilteredSlope, period: float, expected: Scalar = 0.0) -> Scalar:
        """`z0` at the last sample."""
        return state.value
