"""Derivatives of the periodic cycle with respect to every floating leaf, against differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from vgtjax import parameter_table
from vgtjax.exhaust import Engine, OperatingPoint, Valve, steady_cycle

POINT = OperatingPoint(1000.0, 0.476e-3, 1150.0, 1.03e5, 87e-6)
LEAVES = (
    *parameter_table(Engine()),
    "engine_speed",
    "trapped_mass",
    "opening_temperature",
    "outlet_pressure",
    "effective_area",
)
ENGINE = Engine(valve=Valve(opening=140.0625, closing=370.0625))
"""Whose valves open and shut in the middle of a step: the lift's curvature jumps there, and differences across an end
of a step would feel it."""
STEP = 1e-4
"""Relative: differences of fourth order are then right to 1e-9 where the cycle is smooth."""
SMALL = {"valve.opening": 2e-5, "valve.closing": 2e-5}
"""Of these: two steps to either side stay within 0.0625 deg."""
TOLERANCE = {"valve.opening": 1e-6, "valve.closing": 1e-6}
SMOOTH = 1e-8


@pytest.fixture(scope="module")
def problem():
    """A functional of pressure and temperature that no symmetry makes stationary, and where it is looked at."""
    arrays, rest = eqx.partition((ENGINE, POINT), eqx.is_array)
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
    relative = np.array([SMALL.get(leaf, STEP) for leaf in LEAVES])
    steps = np.diag(relative * np.asarray(values))
    shifted = np.asarray(values)[None, None, :] + np.array([-2, -1, 1, 2])[:, None, None] * steps[None]
    low, below, above, high = jax.jit(jax.vmap(functional))(shifted.reshape(-1, len(values))).reshape(4, -1)
    return np.asarray((low - 8 * below + 8 * above - high) / (12 * relative * values))


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
