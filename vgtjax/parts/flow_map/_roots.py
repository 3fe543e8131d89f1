"""Roots of falling functions, and polynomials."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..._types import Values

HALVINGS = 52
"""Leaves 2e-14 of the interval, near the resolution of double precision."""

NEARBY = 1e-3
"""Of the interval; a longer step from a root that bisection has found is rounding. Single precision finds 1e-5."""


def falling_root(function: Callable[[Values], Values], low: Values, high: Values) -> Values:
    """Where a falling function is zero, by bisection; the nearer end where it is not zero between `low` and `high`.

    Elementwise, and NaN where the function is. One step of Newton's follows, for the derivatives with respect to all
    that `function` depends on.
    """

    def halve(_: Int[Array, ""], ends: tuple[Values, Values]) -> tuple[Values, Values]:
        below, above = ends
        middle = 0.5 * (below + above)
        higher = function(middle) > 0
        return jnp.where(higher, middle, below), jnp.where(higher, above, middle)

    low, high = lax.stop_gradient(low), lax.stop_gradient(high)
    below, above = lax.fori_loop(0, HALVINGS, halve, (low, high))
    root = lax.stop_gradient(0.5 * (below + above))
    value, slope = jax.jvp(function, (root,), (jnp.ones_like(root),))
    slope = lax.stop_gradient(slope)
    falls = -slope * NEARBY * (high - low) > jnp.abs(lax.stop_gradient(value))
    step = jnp.where(falls, value / jnp.where(falls, slope, 1.0), 0.0)
    inside = jnp.clip(root - step, low, high)
    first, last = function(low), function(high)
    found = jnp.where(first <= 0, low, jnp.where(last >= 0, high, inside))
    # Bisection takes NaN for too low a value, and would walk to an end that nothing tells from a root.
    return jnp.where(jnp.isnan(first) | jnp.isnan(last) | jnp.isnan(value), jnp.nan, found)


def polynomial(coefficients: Float[Array, " powers"], at: Values) -> Values:
    """`c0 + c1 x + c2 x^2 + ...`, elementwise over `at`."""
    value = coefficients[-1] * jnp.ones_like(at)
    for power in range(coefficients.shape[-1] - 2, -1, -1):
        value = value * at + coefficients[power]
    return value


def slope(coefficients: Float[Array, " powers"], at: Values) -> Values:
    """Derivative of [`polynomial`][] by `at`."""
    powers = jnp.arange(1, coefficients.shape[-1], dtype=coefficients.dtype)
    return polynomial(powers * coefficients[1:], at)
