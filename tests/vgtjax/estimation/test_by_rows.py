"""Rates differentiated by rows, beside forward mode through all that they are made of."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import quick_nozzle

import vgtjax
from vgtjax.estimation.derivatives._by_rows import LARGEST, ByRows
from vgtjax.parts import tabulated

MODELS = {
    "full": vgtjax.Actuator(),
    "map": vgtjax.Actuator(vane_force=vgtjax.SpeedMap(), friction=vgtjax.AdaptiveLuGre()),
    "plunger map": vgtjax.PlungerMapActuator(flow_map=vgtjax.parts.LiftTable()),
    "pneumatic": vgtjax.PneumaticActuator(),
}
TRACE = vgtjax.Trace(
    np.linspace(0.0, 0.1, 11),
    pwm=np.linspace(30.0, 60.0, 11),
    p_res=np.full(11, 20e3),
    p_trb=np.full(11, 40e3),
    x_d=np.linspace(2e-3, 4e-3, 11),
    x_drive=np.linspace(2e-3, 4e-3, 11),
    p_act=np.full(11, 70e3),
)


def inputs_of(model):
    """A model, a state off balance, and the inputs of an interval."""
    drive = jax.tree.map(lambda leaf: leaf[4], TRACE.drive())
    start = model.start(TRACE.start(), drive)
    rng = np.random.default_rng(7)
    state = jax.tree.map(lambda y, size: y + 0.05 * size * rng.standard_normal(), start, model.typical_state())
    return jax.tree.map(jnp.asarray, (model, state, drive))


def assert_same_tangents(model, name, tangents_of):
    """Along several tangents at once, as a fit takes them."""
    inputs = inputs_of(model)
    along = jax.tree.map(tangents_of, inputs)

    def plain(model, state, drive):
        return getattr(model, name)(1e-3, state, drive)

    def by_rows(model, state, drive):
        return getattr(ByRows(model, jnp.asarray(True)), name)(1e-3, state, drive)

    def push(function):
        return jax.jit(jax.vmap(lambda along: jax.jvp(function, inputs, along), out_axes=(None, 0)))(along)

    (values, moved), (expected, exactly) = push(by_rows), push(plain)
    assert jax.tree.structure(values) == jax.tree.structure(expected)
    for found, exact in zip(jax.tree.leaves((values, moved)), jax.tree.leaves((expected, exactly)), strict=True):
        # The same products summed in another order.
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-12 * np.max(np.abs(exact)))


def in_proportion(leaf):
    rng = np.random.default_rng(leaf.size)
    return rng.standard_normal((3, *leaf.shape)) * (1e-3 + np.abs(leaf))[None]


@pytest.mark.parametrize("name", ["vector_field", "relaxation"])
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
def test_tangents_are_those_of_forward_mode(model, name):
    assert_same_tangents(model, name, in_proportion)


def test_tangents_go_through_tables():
    with quick_nozzle():
        model = tabulated(vgtjax.Actuator(vane_force=vgtjax.Turbine()))
    assert any(leaf.size > LARGEST for leaf in jax.tree.leaves(model))
    assert_same_tangents(model, "vector_field", in_proportion)


def test_a_rate_has_no_product_by_what_it_does_not_depend_on():
    """However lost the other tangents are, the rod's position moves with its velocity."""
    model, state, drive = inputs_of(vgtjax.Actuator())
    lost = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.nan), state)
    along = eqx.tree_at(lambda state: state.rod.body.velocity, lost, jnp.asarray(2.0))
    by_rows = ByRows(model, jnp.asarray(True))
    moved = jax.jvp(lambda state: by_rows.vector_field(0.0, state, drive), (state,), (along,))[1]
    assert moved.rod.body.position == 2.0
    assert not np.isfinite(moved.rod.body.velocity)
