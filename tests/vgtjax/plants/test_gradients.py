"""Derivatives with respect to every physical parameter against central differences, solved decades tighter."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, forward_mode, optimised

import vgtjax
from vgtjax import FixedStep, jacobian, parameter_table, select, simulate

ACTUATOR = vgtjax.Actuator()
# Saturated orifice, both stops, both orifices, break-away and sliding in 1.2 s.
TRACE = duty_trace((0, 0.03), (100, 0.45), (45, 0.3), (70, 0.2), (0, 0.24), interval=2e-3, p_res=2.1e4)
"""610 samples: twelve segments and a part."""
EVERY = select(ACTUATOR, free=["*"])
TIGHT = FixedStep(max_step=2e-6)
"""Two and a half decades below the default: a step that straddles a kink (an orifice that opens within 1 um) is
differentiated to first order in its length only, 2e-3 of the norm in the median at 2e-5 s."""
STEP = 1e-6
WEAK_STEP = 1e-4
"""Relative steps of the differences. A kink that moves past a sample spoils a difference by the order of its step, not
the derivative; but what hardly moves the signals needs a larger step against the rounding of 6e5 time steps."""
WEAK = {"friction.static_force", "friction.stribeck_velocity", "diaphragm.stop_damping"}
LIMIT = 1e-4
"""Of the norm. Measured: 3e-6 in the median."""


def observed(theta, stepping, adjoint=None):
    """Position in mm and pressure in kPa, so that both count."""
    run = simulate(EVERY.unpack(ACTUATOR, theta), TRACE, stepping=stepping, adjoint=adjoint, throw=False)
    return jnp.stack([1e3 * run.x_d, 1e-3 * run.p_act])


@pytest.fixture(scope="module")
def derivatives():
    """Forward mode: `(2, time, parameters)`."""
    with optimised():
        return np.asarray(jax.jit(jax.jacfwd(lambda theta: observed(theta, TIGHT)))(EVERY.pack(ACTUATOR)))


@pytest.fixture(scope="module")
def differences():
    """Central differences, all parameters in one batch."""
    theta = np.asarray(EVERY.pack(ACTUATOR))
    steps = [WEAK_STEP if entry in WEAK else STEP for entry in EVERY.entries]
    size = np.where(theta == 0, 1.0, np.abs(theta)) * steps
    shifted = np.concatenate([theta + np.diag(size), theta - np.diag(size)])
    with optimised():
        runs = np.asarray(jax.jit(jax.vmap(lambda t: observed(t, TIGHT)))(shifted))
    up, down = np.split(runs, 2)
    return np.moveaxis((up - down) / (2 * size)[:, None, None], 0, -1)


@pytest.mark.parametrize("entry", EVERY.entries)
def test_forward_mode_is_the_central_difference(entry, derivatives, differences):
    index = EVERY.entries.index(entry)
    exact, difference = derivatives[..., index], differences[..., index]
    assert np.linalg.norm(exact) > 0, "a dead parameter"
    assert np.linalg.norm(exact - difference) <= LIMIT * np.linalg.norm(difference)


@pytest.fixture(scope="module")
def forward():
    """Plain forward mode along the steps that a simulation takes by default: `(2, time, parameters)`."""
    return forward_mode(lambda theta: observed(theta, FixedStep(), diffrax.ForwardMode()), EVERY.pack(ACTUATOR))


@pytest.fixture(scope="module")
def sides(forward):
    """One weighted sum of the signals, differentiated in both modes."""
    weights = np.random.default_rng(1).normal(size=(2, len(TRACE.time)))

    def value(theta):
        return jnp.sum(weights * observed(theta, FixedStep(), diffrax.RecursiveCheckpointAdjoint()))

    reverse = jax.jit(jax.grad(value))(EVERY.pack(ACTUATOR))
    return np.tensordot(weights, forward), np.asarray(reverse)


@pytest.mark.parametrize("entry", EVERY.entries)
def test_reverse_equals_forward(entry, sides):
    """The same steps differentiated in the other order; the sum over time cancels three digits."""
    index = EVERY.entries.index(entry)
    forward, reverse = sides
    assert reverse[index] == pytest.approx(forward[index], rel=1e-9)
    assert forward[index] != 0


@pytest.fixture(scope="module")
def columns():
    """The segment-parallel Jacobian with respect to every parameter: `(time, 2, parameters)`."""
    return jacobian(ACTUATOR, [TRACE], free=["*"])[0]


def test_segments_in_parallel_are_plain_forward_mode(columns, forward):
    exact = np.moveaxis(forward, 0, 1) / np.array([[1e3], [1e-3]])
    assert columns.shape == (len(TRACE.time), 2, len(EVERY.entries))
    scale = np.linalg.norm(exact, axis=(0, 1))
    # Same arithmetic in another order, 2440 steps: a thousand roundings.
    assert np.max(np.linalg.norm(columns - exact, axis=(0, 1)) / scale) < 1e-12


FEW = ["diaphragm.stiffness", "chamber.volume", "converter.magnetic_force[0]"]
"""Of several tests, whose traces have three segments: one compiled function."""


def test_traces_of_different_length_and_rate_keep_their_place():
    short = duty_trace((0, 0.03), (60, 0.1), p_res=2.0e4)
    slow = duty_trace((0, 0.1), (80, 0.4), p_res=2.0e4, interval=1e-2)
    long = duty_trace((0, 0.03), (90, 0.4), p_res=2.5e4)
    together = jacobian(ACTUATOR, [short, slow, long], free=FEW)
    for trace, found in zip((short, slow, long), together, strict=True):
        alone = jacobian(ACTUATOR, [trace], free=FEW)[0]
        assert found.shape == (len(trace.time), 2, len(FEW))
        np.testing.assert_allclose(found, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())


def test_start_in_mid_run_has_derivatives_too():
    """Its pressure is that of static balance, which the parameters move."""
    trace = duty_trace((60, 0.15), p_res=2.0e4)
    first = jacobian(ACTUATOR, [trace], free=FEW)[0][0]
    force = select(ACTUATOR, FEW).entries.index("converter.magnetic_force[0]")
    assert first[1, force] == pytest.approx(-1 / 1.7425e-4, rel=1e-12)


NULL = {  # directions that scale parameters together and change no measured signal: name, exponent of the scale
    "plunger forces": {
        name: 1
        for name in (
            "converter.plunger_mass",
            "converter.membrane_stiffness",
            "converter.return_spring_stiffness",
            "converter.plunger_damping",
            "converter.actuator_area",
            "converter.atmosphere_area",
            "converter.reservoir_area",
            "converter.magnetic_force",
        )
    },
    "gas against areas": {
        "air.gas_constant": 2,
        "converter.reservoir_orifice_slope": -1,
        "converter.atmosphere_orifice": -1,
    },
    "diaphragm": {
        "diaphragm.area": 1,
        "chamber.volume": 1,
        "diaphragm.stiffness": 1,
        "diaphragm.preload": 1,
        "diaphragm.mass": 1,
        "diaphragm.stop_stiffness": 1,
        "friction.static_force": 1,
        "friction.coulomb_force": 1,
        "friction.bristle_stiffness": 1,
        "friction.bristle_damping": 1,
        "friction.viscous_damping": 1,
        "converter.reservoir_orifice_slope": 1,
        "converter.atmosphere_orifice": 1,
    },
}


@pytest.mark.parametrize("direction", NULL)
def test_known_null_directions_change_nothing(direction, columns):
    table = parameter_table(ACTUATOR)
    move = np.zeros(len(EVERY.entries))
    for name, power in NULL[direction].items():
        for index, entry in enumerate(EVERY.entries):
            if entry.split("[")[0] == name:
                assert name in table
                move[index] = power * float(EVERY.pack(ACTUATOR)[index])
    together = np.abs(columns @ move).max(axis=0)
    alone = np.abs(columns * move).max(axis=(0, 2))
    assert np.all(together < 1e-10 * alone)


def test_damping_of_diaphragm_and_bristles_is_one_parameter(columns):
    """Erratum 11."""
    names = ("diaphragm.damping", "friction.viscous_damping")
    diaphragm, bristles = (columns[..., EVERY.entries.index(name)] for name in names)
    np.testing.assert_allclose(diaphragm, bristles, rtol=1e-9, atol=1e-9 * np.abs(bristles).max())


def test_a_simulation_that_fails_has_no_derivatives():
    bad = vgtjax.replace_parameters(ACTUATOR, {"chamber.volume": 1e-6})
    with pytest.raises(vgtjax.SimulationError, match="trace 'trace' failed: The diaphragm swallows the chamber"):
        jacobian(bad, [duty_trace((0, 0.05), (90, 0.1), p_res=2.0e4)], free=FEW)
