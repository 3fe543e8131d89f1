"""Force at the rod: its derivatives with respect to every leaf of a stage, from open vanes to a row that is sonic."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax.parts import Stage
from vgtjax.parts.vane_force._stage import flow_at
from vgtjax.turbine import VANES

CELLS, STEP = 112, 1e-4
SONIC = Stage(outlet_pressure=0.6e5, speed_ratio=0.276)
"""Before 3 bar its vanes' row is choked at a crank angle of 4.66 deg."""
NAMES = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(SONIC)]


def rod_force(factors, leaves, pressure, angle, near):
    """Of a stage whose every leaf is so many times what it was, by a rotor that turns by the ratio, searched from
    states nearby."""
    shape = jax.tree.structure(SONIC)
    stage = jax.tree.unflatten(shape, [leaf * factor for leaf, factor in zip(leaves, factors, strict=True)])
    flow, values, _ = flow_at(stage, pressure, angle, CELLS, near)
    return values, flow


def place(stage, pressure, angle):
    """Arguments of a stage, and its states there: four searches a leaf from gas at rest take ten times as long."""
    at = jnp.asarray(pressure), jnp.asarray(angle)
    return jax.tree.leaves(stage), *at, flow_at(stage, *at, CELLS)[2]


solved = jax.jit(rod_force)


@jax.jit
def slopes(factors, *where):
    """With respect to each factor, one after the other, which compiles in half the time."""

    def along(way):
        return jax.jvp(lambda moved: rod_force(moved, *where)[0], (factors,), (way,))[1]

    return jax.lax.map(along, jnp.eye(len(factors)))


@pytest.mark.parametrize(
    ("stage", "pressure", "angle"),
    [(Stage(), 2e5, 4.66), (Stage(), 2e5, 33.0), (SONIC, 3e5, 4.66)],
    ids=["closed", "open", "sonic"],
)
def test_every_leaf(stage, pressure, angle):
    where = place(stage, pressure, angle)
    ones = np.ones(len(NAMES))
    exact = np.asarray(slopes(ones, *where))
    for number, name in enumerate(NAMES):

        def moved(times, number=number):
            return np.asarray(solved(ones + times * STEP * np.eye(len(NAMES))[number], *where)[0])

        slope = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * STEP)
        # Steady states are found to 1e-12, which this step makes 1e-8; beside the largest derivative of all.
        allowed = 1e-6 * np.abs(exact[number]) + 1e-8 * np.max(np.abs(exact), axis=0)
        assert np.all(np.abs(exact[number] - slope) <= allowed), (name, exact[number], slope)


def test_that_state_is_sonic_and_choked():
    """The vanes' row passes its most: of a change of the outlet's pressure less than 2 % is passed on, and more than a
    fifth when they are open."""
    outlet = NAMES.index(".outlet_pressure")
    passed, flows = [], []
    for stage, pressure, angle in ((SONIC, 3e5, 4.66), (Stage(), 2e5, 33.0)):
        where = place(stage, pressure, angle)
        ones = np.ones(len(NAMES))
        values, flow = solved(ones, *where)
        passed.append(abs(float(slopes(ones, *where)[outlet, 1] / values[1])))
        flows.append(flow)
    assert passed[0] < 0.02
    assert passed[1] > 0.2
    passage, _ = SONIC.passage(jnp.asarray(3e5), jnp.asarray(4.66), CELLS)
    flow = flows[0]
    last = np.flatnonzero(passage.row == VANES)[-1]
    mach = np.hypot(flow.v_m, flow.v_u)[: last + 1] / np.asarray(SONIC.gas.sound_speed(flow.temperature[: last + 1]))
    assert np.max(mach) > 1.0
