"""Nothing is NaN, nor infinite, from no pressure difference to 4.5 bar, closed to open, standing still to twice the
design speed: force at the rod, mass flow, and their derivatives in both modes, all points in one call."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax.parts import Stage
from vgtjax.parts.vane_force._stage import flow_at

CELLS, OUTLET = 28, 1.05e5
"""An eighth of the usual cells, for time."""
PRESSURES = OUTLET * np.array([1.0, 1 + 1e-12, 1 + 1e-6, 1 + 1e-3]), np.array([1.5e5, 2.5e5, 4.5e5])
"""Pa absolute: at and just above the outlet's, where flow goes with the root of the difference; and beyond."""
POINTS = np.array(list(itertools.product(np.concatenate(PRESSURES), (4.0, 12.0, 25.0, 37.0), (0.0, 1.0, 2.0))))
"""Total pressure in Pa absolute, angle of the crank in deg, speed over that of the design."""
LEAVES, SHAPE = jax.tree.flatten((Stage(), jnp.asarray(2e5), jnp.asarray(4.0)))
NAMES = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path((Stage(), 2e5, 4.0))]
SPEED_RATIO, PRESSURE, ANGLE = NAMES.index("[0].speed_ratio"), len(LEAVES) - 2, len(LEAVES) - 1
AHEAD = (SPEED_RATIO, PRESSURE, ANGLE)


def answers(values):
    """Force in N and mass flow in 10 g/s of a stage's values, a pressure and an angle; whether the flow was found."""
    flow, (force, passed), _ = flow_at(*jax.tree.unflatten(SHAPE, list(values)), CELLS)
    return jnp.stack([force, 100 * passed]), flow.converged


def everything(point):
    """Answers, and both modes of their derivatives with respect to the logarithm of every value of the stage."""
    pressure, angle, times = point
    values = jnp.stack(LEAVES).at[SPEED_RATIO].multiply(times).at[PRESSURE].set(pressure).at[ANGLE].set(angle)
    ones = jnp.ones(len(LEAVES))
    value, derivative, found = jax.linearize(lambda factors: answers(values * factors), ones, has_aux=True)
    forward = jax.vmap(derivative)(jnp.eye(len(LEAVES))[np.array(AHEAD)]).T
    (reverse,) = jax.vmap(jax.linear_transpose(derivative, ones))(jnp.eye(2))
    return value, forward, reverse, found


@pytest.fixture(scope="module")
def found():
    # Lanes of two: in one of all, each would wait for the hardest, which is ten times as long.
    return [np.asarray(each) for each in jax.jit(lambda points: jax.lax.map(everything, points, batch_size=2))(POINTS)]


def test_every_state_is_found(found):
    assert POINTS[~found[3]].tolist() == []


def test_nothing_is_nan_or_infinite(found):
    for what, each in zip(("answers", "forward mode", "reverse mode"), found, strict=False):
        finite = np.isfinite(each.reshape(len(POINTS), -1)).all(axis=1)
        assert POINTS[~finite].tolist() == [], what


def test_both_modes_are_the_same_derivatives(found):
    """Beside the largest of a point, to rounding; a thousandth above the outlet's pressure that is 2e-8."""
    forward, reverse = found[1], found[2][..., np.array(AHEAD)]
    apart = np.max(np.abs(forward - reverse), axis=(1, 2)) / np.max(np.abs(found[2]), axis=(1, 2))
    assert np.max(apart[POINTS[:, 0] > 1.4e5]) < 1e-9
    assert np.max(apart[POINTS[:, 0] > 1.0005 * OUTLET]) < 1e-7


def test_where_there_is_no_difference_hardly_anything_flows(found):
    at_rest, above = POINTS[:, 0] == OUTLET, POINTS[:, 0] == OUTLET * (1 + 1e-3)
    assert np.max(np.abs(found[0][at_rest, 1])) < 1e-3  # 1e-5 kg/s
    assert np.min(found[0][above & (POINTS[:, 2] == 0.0), 1]) > 1e-2
