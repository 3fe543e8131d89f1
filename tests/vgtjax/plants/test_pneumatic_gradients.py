"""Lines, coil and chambers in the whole actuator: derivatives with respect to all parameters, other ways to run it."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, forward_mode, optimised, rms

import vgtjax
from vgtjax import Actuator, AdaptiveStep, Converter, FixedStep, jacobian, select, simulate

COIL = Converter(magnetic_force=vgtjax.Coil())
WALL = vgtjax.WallChamber(wall_conductance=0.1, wall_temperature=300.0)
TOGETHER = {
    "delay, coil, wall": Actuator(line=vgtjax.DelayLine(), converter=COIL, chamber=WALL),
    "wave, isothermal": Actuator(line=vgtjax.WaveLine(), chamber=vgtjax.IsothermalChamber()),
}
MODELS = {
    "delay, wall": (Actuator(line=vgtjax.DelayLine(), chamber=WALL), ["line.*", "chamber.*"]),
    "wave, isothermal": (TOGETHER["wave, isothermal"], ["line.*", "chamber.*"]),
    "coil": (Actuator(converter=COIL), ["converter.magnetic_force.*"]),
    "short delay": (Actuator(line=vgtjax.DelayLine(length=0.1, cells=2)), ["line.*"]),
    "short wave": (Actuator(line=vgtjax.WaveLine(length=0.1, cells=3)), ["line.*"]),
}
"""Lines with chambers, as a model is slow to compile; the coil alone, whose kinks would pass more samples of a line."""
CASES = [(name, entry) for name, case in MODELS.items() for entry in select(*case).entries]
TRACE = duty_trace((0, 0.03), (100, 0.22), (40, 0.15), (0, 0.15), interval=2e-3, p_res=2.1e4)
"""Both orifices, saturation and a stop."""
TIGHT = FixedStep(max_step=8e-6)
"""A sixtieth of the default: a step that straddles a kink is differentiated to first order in its length only."""
STEP = 1e-6
"""Relative step of the differences: a larger one moves kinks past samples."""
LIMIT = 1e-4
"""Of the norm. Measured: 2e-5 of the weakest, which are differences of rounding; else below 4e-6. Shorter steps do no
better."""


def observed(model, stepping, adjoint=None):
    """Position in mm and pressure in kPa, so that both count."""
    run = simulate(model, TRACE, stepping=stepping, adjoint=adjoint, throw=False)
    return jnp.stack([1e3 * run.x_d, 1e-3 * run.p_act], axis=1)


@pytest.fixture(scope="module")
def slopes():
    """Per model: exact derivatives and central differences, each `(time, 2, parameters)`."""
    with optimised():  # seventy thousand steps each
        return {name: both_ways(*case) for name, case in MODELS.items()}


def both_ways(model, patterns):
    selection = select(model, patterns)
    exact = jacobian(model, [TRACE], selection.entries, stepping=TIGHT)[0] * np.array([[1e3], [1e-3]])
    theta = np.asarray(selection.pack(model))
    size = STEP * np.abs(theta)
    shifted = np.concatenate([theta + np.diag(size), theta - np.diag(size)])
    runs = jax.jit(jax.vmap(lambda t: observed(selection.unpack(model, t), TIGHT)))(shifted)
    up, down = np.split(np.asarray(runs), 2)
    return exact, np.moveaxis((up - down) / (2 * size)[:, None, None], 0, -1)


@pytest.mark.parametrize(("name", "entry"), CASES)
def test_the_jacobian_is_the_central_difference(name, entry, slopes):
    index = select(*MODELS[name]).entries.index(entry)
    exact, difference = (columns[..., index] for columns in slopes[name])
    assert np.linalg.norm(exact) > 0, "a dead parameter"
    assert np.linalg.norm(exact - difference) <= LIMIT * np.linalg.norm(difference)


@pytest.mark.parametrize("name", TOGETHER)
def test_every_step_reverses(name):
    """`w (J v) = (w J) v` at every sample of the trace, for states and parameters; a sum of 40 products."""
    model = TOGETHER[name]
    states = simulate(model, TRACE).states
    drive = jax.tree.map(jnp.asarray, TRACE.drive())
    plan = FixedStep().plan(model, TRACE)
    selection = select(model, ["line.*", "converter.magnetic_force*", "chamber.*"])
    theta = selection.pack(model)
    size = (jax.tree.map(jnp.asarray, model.typical_state()), jnp.abs(theta))

    def like(tree, rng):
        return jax.tree.map(lambda leaf: leaf * rng.normal(size=leaf.shape), tree)

    rng = np.random.default_rng(1)
    ahead, back = like(size, rng), like(jax.tree.map(lambda leaf: 1 / leaf, size[0]), rng)

    def products(given):
        inputs, state = given

        def advance(state, theta):
            return plan.advance(selection.unpack(model, theta), state, inputs)[0]

        pushed = jax.jvp(advance, (state, theta), ahead)[1]
        pulled = jax.vjp(advance, state, theta)[1](back)
        return dot(back, pushed), dot(pulled, ahead)

    # One sample after the other compiles twice as fast as all side by side.
    forward, reverse = jax.jit(lambda given: jax.lax.map(products, given))((drive, states))
    np.testing.assert_allclose(reverse, forward, rtol=1e-9, atol=1e-9)


def dot(one, other):
    return sum(jnp.sum(a * b) for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True))


def test_reverse_mode_along_a_trace():
    """The same steps differentiated in the other order; the sum over time cancels three digits."""
    model, patterns = MODELS["short delay"]
    selection = select(model, patterns)
    weights = jnp.asarray(np.random.default_rng(1).normal(size=(len(TRACE.time), 2)))

    def value(theta, adjoint):
        return jnp.sum(weights * observed(selection.unpack(model, theta), FixedStep(), adjoint))

    theta = selection.pack(model)
    reverse = jax.jit(jax.grad(lambda t: value(t, diffrax.RecursiveCheckpointAdjoint())))(theta)
    forward = forward_mode(lambda t: value(t, diffrax.ForwardMode()), theta)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)


@pytest.mark.parametrize("name", TOGETHER)
def test_error_controlled_steps_agree(name):
    """Half a millisecond is worth 0.2 um and 2 Pa on duty steps without these components, and not more with them."""
    fixed, adaptive = simulate(TOGETHER[name], TRACE), simulate(TOGETHER[name], TRACE, stepping=AdaptiveStep())
    assert rms(fixed.x_d - adaptive.x_d) < 2e-7
    assert rms(fixed.p_act - adaptive.p_act) < 2


@pytest.mark.parametrize("name", TOGETHER)
def test_single_precision_will_do(name):
    """A bar has 0.01 Pa of rounding, which a thousand steps pile up."""
    single = jax.tree.map(lambda leaf: leaf.astype(np.float32), TOGETHER[name])
    run, exact = simulate(single, TRACE), simulate(TOGETHER[name], TRACE)
    assert run.x_d.dtype == np.float32
    assert rms(np.asarray(run.p_act) - np.asarray(exact.p_act)) < 10
