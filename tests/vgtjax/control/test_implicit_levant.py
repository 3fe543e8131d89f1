"""Levant's differentiator by implicit Euler: its equations, no chatter, its noise, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax.control import ImplicitLevantDifferentiator, LevantDifferentiator

PERIOD = 1e-3
BOUND = 5.0


def slopes(differentiator, values):
    def sample(state, value):
        state, slope = differentiator.update(state, value, PERIOD)
        return state, (slope, differentiator.value(state, PERIOD))

    return jax.lax.scan(sample, differentiator.initial_state(values[0]), values)[1]


@pytest.mark.parametrize("jump", [1e-3, 1e-6, 2e-6, -4e-3])
def test_a_step_solves_the_implicit_equations(jump):
    levant = ImplicitLevantDifferentiator(BOUND)
    start = levant.initial_state(jnp.asarray(0.01))
    after, slope = levant.update(start, jnp.asarray(0.01 + jump), PERIOD)
    s = float(after.value) - (0.01 + jump)
    # Where s is zero the sign is whatever makes it so.
    sign = np.sign(s) if abs(s) > 1e-15 else -float(slope) / (1.1 * BOUND * PERIOD)
    assert abs(sign) <= 1
    rate = float(slope) - 1.5 * np.sqrt(BOUND * abs(s)) * np.sign(s)
    # Rounding of 0.01 over the period.
    assert float(after.value) - 0.01 == pytest.approx(PERIOD * rate, abs=1e-15)
    assert float(slope) == pytest.approx(-1.1 * PERIOD * BOUND * sign, abs=1e-12)


def test_it_is_exact_below_its_bound_and_does_not_chatter():
    """A parabola of half the bound, after it has settled; the explicit step swings by some h L."""
    time = jnp.arange(1000) * PERIOD
    values = 0.5 * (0.5 * BOUND) * time**2 + 0.01 * time
    slope, value = (np.asarray(each)[500:] for each in slopes(ImplicitLevantDifferentiator(BOUND), values))
    # The backward difference of a parabola lags half a period: h a / 2.
    np.testing.assert_allclose(slope, 0.01 + 0.5 * BOUND * (time[500:] - 0.5 * PERIOD), atol=1e-10)
    np.testing.assert_allclose(value, values[500:], atol=1e-14)
    explicit = np.asarray(slopes(LevantDifferentiator(BOUND), values)[0])[500:]
    assert np.std(np.diff(explicit)) > 0.1 * PERIOD * BOUND
    assert np.std(np.diff(slope)) < 1e-9


def test_noise_reaches_the_slope_by_its_root():
    noise = 8e-6 * np.random.default_rng(1).standard_normal(4000)
    found = [
        np.std(np.asarray(slopes(ImplicitLevantDifferentiator(each), jnp.asarray(noise))[0])) for each in (5.0, 0.05)
    ]
    # sqrt(2 L noise) is 8.9 and 0.89 mm/s; the order of it.
    assert 0.2 * 8.9e-3 < found[0] < 2 * 8.9e-3
    assert 0.05 * 0.89e-3 < found[1] < 2 * 0.89e-3


def test_derivatives_with_respect_to_the_bound_are_central_differences():
    values = 1e-3 * jnp.sin(40 * jnp.arange(200) * PERIOD)
    cost = jax.jit(lambda bound: jnp.sum(slopes(ImplicitLevantDifferentiator(bound), values)[0] ** 2))
    slope, step = float(jax.jit(jax.jacfwd(cost))(0.5)), 1e-6
    # A closed form but for kinks that the step straddles.
    assert slope == pytest.approx((float(cost(0.5 + step)) - float(cost(0.5 - step))) / (2 * step), rel=1e-4)
    assert slope != 0
