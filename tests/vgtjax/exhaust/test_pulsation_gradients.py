"""Derivatives of the periodic cycle with respect to every floating leaf, against differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from vgtjax import parameter_table
from vgtjax.exhaust import Engine, OperatingPoint, steady_cycle

POINT = OperatingPoint(1000.0, 0.476e-3, 1150.0, 1.03e5, 87e-6)
LEAVES = (
    *parameter_table(Engine()),
    "engine_speed",
    "trapped_mass",
    "opening_temperature",
    "outlet_pressure",
    "effective_area",
)
STEP = 1e-4
"""Relative: differences of fourth order are then right to 1e-9 where the cycle is smooth."""
SMOOTH = 1e-8
TOLERANCE = {"valve.opening": 2e-6, "valve.closing": 1e-5}
"""The lift's curvature jumps where a valve opens and shuts; fixed steps feel when it does to second order only."""


@pytest.fixture(scope="module")
def problem():
    """A functional of pressure and temperature that no symmetry makes stationary, and where it is looked at."""
    arrays, rest = eqx.partition((Engine(), POINT), eqx.is_array)
    values, unravel = ravel_pytree(arrays)
    weights = np.random.default_rng(0).normal(size=1440) / 1440**0.5

    def functional(values):
        cycle, _ = steady_cycle(*eqx.combine(unravel(values), rest))
        return jnp.dot(weights, cycle.p_trb / 1e5) + jnp.dot(weights, cycle.temperature / 900)

    return jax.jit(functional), values


@pytest.fixture(scope="module")
def reverse(problem):
    functional, values = problem
    return np.asarray(jax.jit(jax.grad(functional))(values))


@pytest.fixture(scope="module")
def differences(problem):
    functional, values = problem
    steps = STEP * np.diag(values)
    shifted = np.asarray(values)[None, None, :] + np.array([-2, -1, 1, 2])[:, None, None] * steps[None]
    low, below, above, high = jax.jit(jax.vmap(functional))(shifted.reshape(-1, len(values))).reshape(4, -1)
    return np.asarray((low - 8 * below + 8 * above - high) / (12 * STEP * values))


@pytest.mark.parametrize("leaf", LEAVES)
def test_reverse_mode_is_what_differences_say(reverse, differences, leaf):
    at = LEAVES.index(leaf)
    assert reverse[at] != 0
    assert reverse[at] == pytest.approx(differences[at], rel=TOLERANCE.get(leaf, SMOOTH))


def test_every_leaf_is_looked_at(reverse):
    assert len(reverse) == len(LEAVES)


def test_forward_mode_is_reverse_mode(problem, reverse):
    functional, values = problem
    direction = np.random.default_rng(1).normal(size=len(LEAVES)) * np.asarray(values)
    along = jax.jit(lambda v, d: jax.jvp(functional, (v,), (d,))[1])(values, direction)
    assert float(along) == pytest.approx(float(np.dot(reverse, direction)), rel=1e-9)  # rounding, through the root
