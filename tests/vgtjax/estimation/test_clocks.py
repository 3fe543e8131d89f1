"""Estimation from traces whose channels have clocks of their own, and invalid samples."""

import jax
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax.estimation import build_fit_problem, calibrate, plan_task
from vgtjax.experiments import validate
from vgtjax.parameters import build_transform

TRUTH = {"diaphragm.stiffness": 12600.0, "diaphragm.preload": 51.0, "chamber.volume": 57e-6}
FREE = list(TRUTH)
NOISE = {"x_d": 8e-6, "p_act": 60.0}
OFFSET = {"x_d": 2e-5, "p_act": -150.0}
STEPS = (0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3)


def recorded(trace, seed=0):
    """`trace` with the position and pressure of known parameters at its own samples: noisy, and off by constants."""
    run = vgtjax.simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), trace)
    rng = np.random.default_rng(seed)
    signals = {}
    for name, noise in NOISE.items():
        clean = np.asarray(getattr(run, name))[trace.rows(name)]
        measured = clean + OFFSET[name] + rng.normal(0, noise, len(clean))
        signals[name] = vgtjax.Channel(trace.sampled(name).time, measured)
    return trace.replace(**signals)


@pytest.fixture(scope="module")
def own():
    """Duty at 100 Hz, position at 1 kHz and 0.3 ms late, pressure at 500 Hz, a supply that sags at 10 Hz."""
    duty = duty_trace(*STEPS, interval=0.01)
    clocks = {"x_d": 0.0003 + np.arange(980) * 1e-3, "p_act": np.arange(491) * 2e-3, "p_res": np.arange(11) * 0.1}
    values = {"x_d": np.zeros(980), "p_act": np.full(491, 101013.0), "p_res": 2e4 + 2e3 * clocks["p_res"]}
    channels = {name: vgtjax.Channel(clocks[name], values[name]) for name in clocks}
    return recorded(vgtjax.Trace(pwm=vgtjax.Channel(duty.time, duty.pwm), **channels))


@pytest.fixture(scope="module")
def common():
    bare = duty_trace((0, 0.03), (70, 0.2), x_d=0.0, p_act=101013.0)
    return recorded(bare)


def residuals(trace):
    task = plan_task(vgtjax.Actuator(), [trace], free=FREE)
    start = np.asarray(task.selection.pack(task.model))
    transform = build_transform(vgtjax.parameter_table(task.model), task.selection.entries, start, {})
    problem = build_fit_problem(task.model, task.selection, transform, [trace])
    return np.asarray(problem.residuals(np.asarray(transform.to_coordinates(start)))), problem.count


@pytest.fixture(scope="module")
def fitted(own):
    return calibrate(plan_task(vgtjax.Actuator(), [own], free=FREE))


def test_parameters_are_recovered_from_channels_on_different_clocks(fitted):
    assert fitted.progress.converged
    truth = np.array([TRUTH[entry] for entry in fitted.task.selection.entries])
    assert np.all(np.abs(fitted.values - truth) < 4 * fitted.std_errors)  # four standard errors
    assert np.all(fitted.std_errors < 0.02 * truth)
    assert fitted.uncertainty.scale == pytest.approx(1.0, abs=0.15)


def test_a_channel_is_compared_where_it_was_sampled(fitted, own):
    (result,) = fitted.traces
    assert fitted.count == sum(len(own.sampled(name).time) for name in NOISE)
    for name, channel in result.channels.items():
        np.testing.assert_array_equal(channel.time, own.sampled(name).time)
        np.testing.assert_array_equal(channel.measured, own.sampled(name).value)
        np.testing.assert_array_equal(channel.simulated, result.simulated[name][own.rows(name)])
        assert channel.noise == pytest.approx(NOISE[name], rel=0.2)
        assert channel.rmse == pytest.approx(NOISE[name], rel=0.1)
        assert np.std(channel.residual) == pytest.approx(channel.rmse)
        assert np.mean(channel.residual) == pytest.approx(0.0, abs=1e-9 * NOISE[name])
    assert result.offset["x_d"] == pytest.approx(OFFSET["x_d"], abs=3e-6)
    assert result.offset["p_act"] == pytest.approx(OFFSET["p_act"], abs=25)


def test_the_jacobian_of_each_channel_is_that_of_forward_mode_at_its_samples(own):
    model = vgtjax.Actuator()
    (found,) = vgtjax.jacobian(model, [own], free=FREE)
    selection = vgtjax.select(model, FREE)

    def signals(theta):
        run = vgtjax.simulate(selection.unpack(model, theta), own, throw=False)
        return {name: getattr(run, name)[own.rows(name)] for name in NOISE}

    expected = jax.jacfwd(signals)(selection.pack(model))
    assert found.keys() == expected.keys()
    for name, columns in expected.items():
        assert found[name].shape == (len(own.sampled(name).time), len(FREE))
        scale = np.abs(np.asarray(columns)).max(axis=0)
        np.testing.assert_allclose(found[name] / scale, np.asarray(columns) / scale, atol=1e-9)


def test_clocks_that_coincide_give_the_numbers_of_one_common_clock(common):
    apart = vgtjax.Trace(**{name: vgtjax.Channel(common.time.copy(), c.value) for name, c in common.channels.items()})
    assert apart.has_common_clock
    one, other = vgtjax.jacobian(vgtjax.Actuator(), [common, apart], free=FREE)
    assert one.shape == (len(common.time), 2, len(FREE))
    np.testing.assert_array_equal(one, other)
    for first, second in zip(residuals(common), residuals(apart), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", ["x_d", "p_act"])
def test_an_invalid_sample_is_no_residual_whatever_it_holds(common, name):
    valid = np.random.default_rng(1).random(len(common.time)) > 0.1
    found = []
    for rubbish in (np.nan, -1e30):
        holding = np.where(valid, common.channels[name].value, rubbish)
        trace = common.replace(**{name: vgtjax.Channel(common.time, holding, valid)})
        np.testing.assert_array_equal(trace.time, common.time)
        found.append(residuals(trace))
    assert found[0][1] == found[1][1] == 2 * len(common.time) - np.count_nonzero(~valid)
    np.testing.assert_array_equal(found[0][0], found[1][0])
    whole = vgtjax.jacobian(vgtjax.Actuator(), [common], free=FREE)[0]
    part = vgtjax.jacobian(vgtjax.Actuator(), [trace], free=FREE)[0]
    for channel, each in enumerate(("x_d", "p_act")):
        np.testing.assert_array_equal(part[each], whole[valid if each == name else slice(None), channel])


def test_a_validation_compares_where_each_channel_was_sampled(own):
    model = vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH)
    found = validate({"truth": model}, own)
    assert found.deviations["truth"].position_rmse == pytest.approx(NOISE["x_d"], rel=0.1)
    assert found.deviations["truth"].pressure_rmse == pytest.approx(NOISE["p_act"], rel=0.1)
    np.testing.assert_allclose(own.x_d - found.measured.x_d, OFFSET["x_d"], atol=2e-6)
