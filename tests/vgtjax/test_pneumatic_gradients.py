"""Lines, coil and chambers in the whole actuator: derivatives by every parameter of theirs, and the two steppings."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import Actuator, AdaptiveStep, Converter, FixedStep, jacobian, select, simulate

MODELS = {
    "delay": Actuator(line=vgtjax.DelayLine()),
    "short delay": Actuator(line=vgtjax.DelayLine(length=0.1, cells=2)),
    "wave": Actuator(line=vgtjax.WaveLine(cells=2)),
    "short wave": Actuator(line=vgtjax.WaveLine(length=0.1, cells=3)),
    "coil": Actuator(converter=Converter(magnetic_force=vgtjax.Coil())),
    "wall": Actuator(chamber=vgtjax.WallChamber(wall_conductance=0.1)),
    "isothermal": Actuator(chamber=vgtjax.IsothermalChamber()),
}
NEW = {
    name: select(model, [f"{part}.*"])
    for name, model in MODELS.items()
    for part in ("line", "converter.magnetic_force", "chamber")
    if part.split(".")[-1] in {"coil": "magnetic_force", "wall": "chamber", "isothermal": "chamber"}.get(name, "line")
}
CASES = [(name, entry) for name, selection in NEW.items() for entry in selection.entries]
# Both orifices, saturation, a stop and both directions of flow.
TRACE = duty_trace((0, 0.03), (100, 0.22), (40, 0.15), (0, 0.15), interval=2e-3, p_res=2.1e4)
TIGHT = FixedStep(max_step=2e-6)
"""Two decades below the default: a step that straddles a kink is differentiated to first order in its length only."""
STEP = 1e-5
"""Relative step of the differences."""
LIMIT = 1e-4
"""Of the norm."""


def observed(name, theta, stepping, adjoint=None):
    """Position in mm and pressure in kPa, so that both count."""
    model = NEW[name].unpack(MODELS[name], theta)
    run = simulate(model, TRACE, stepping=stepping, adjoint=adjoint, throw=False)
    return jnp.stack([1e3 * run.x_d, 1e-3 * run.p_act], axis=1)


@pytest.fixture(scope="module")
def slopes():
    """Per model: exact derivatives and central differences, each `(time, 2, parameters)`."""
    return {name: both_ways(name) for name in MODELS}


def both_ways(name):
    exact = jacobian(MODELS[name], [TRACE], NEW[name].entries, stepping=TIGHT)[0] * np.array([[1e3], [1e-3]])
    theta = np.asarray(NEW[name].pack(MODELS[name]))
    size = STEP * np.abs(theta)
    shifted = np.concatenate([theta + np.diag(size), theta - np.diag(size)])
    up, down = np.split(np.asarray(jax.jit(jax.vmap(lambda t: observed(name, t, TIGHT)))(shifted)), 2)
    return exact, np.moveaxis((up - down) / (2 * size)[:, None, None], 0, -1)


@pytest.mark.parametrize(("name", "entry"), CASES)
def test_the_jacobian_is_the_central_difference(name, entry, slopes):
    index = NEW[name].entries.index(entry)
    exact, difference = (columns[..., index] for columns in slopes[name])
    assert np.linalg.norm(exact) > 0, "a dead parameter"
    assert np.linalg.norm(exact - difference) <= LIMIT * np.linalg.norm(difference)


@pytest.mark.parametrize("name", MODELS)
def test_reverse_equals_forward(name):
    """The same steps differentiated in the other order; the sum over time cancels three digits."""
    theta = NEW[name].pack(MODELS[name])
    weights = jnp.asarray(np.random.default_rng(1).normal(size=(len(TRACE.time), 2)))

    def value(t, adjoint):
        return jnp.sum(weights * observed(name, t, FixedStep(), adjoint))

    reverse = jax.jit(jax.grad(lambda t: value(t, diffrax.RecursiveCheckpointAdjoint())))(theta)
    forward = jax.jit(jax.jacfwd(lambda t: value(t, diffrax.ForwardMode())))(theta)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_error_controlled_steps_agree(name):
    """Half a millisecond is worth 0.1 um and 2 Pa on these duty steps, whatever the components."""
    fixed, adaptive = simulate(MODELS[name], TRACE), simulate(MODELS[name], TRACE, stepping=AdaptiveStep())
    assert rms(fixed.x_d - adaptive.x_d) < 5e-7
    assert rms(fixed.p_act - adaptive.p_act) < 5


@pytest.mark.parametrize("name", MODELS)
def test_single_precision_will_do(name):
    """Rounding of 7 digits of a bar is 0.01 Pa, a thousand steps of it."""
    single = jax.tree.map(lambda leaf: leaf.astype(np.float32), MODELS[name])
    run, exact = simulate(single, TRACE), simulate(MODELS[name], TRACE)
    assert run.x_d.dtype == np.float32
    assert rms(np.asarray(run.p_act) - np.asarray(exact.p_act)) < 20
