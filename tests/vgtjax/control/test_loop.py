"""The closed loop: exactness against simulation, sampling, derivatives, batches, failure, memory."""

import dataclasses

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import control
from vgtjax.control import PI, PID, ConstantDuty, Knocker, Scenario, Sensors, Sine, StaticBalance, close_loop

REVERSE = diffrax.RecursiveCheckpointAdjoint()
SHORT = 0.4
"""s; long enough for the rod to move by millimetres."""
WAVE = Sine(amplitude=0.001, rate=20.0, offset=0.004)

SIMPLE = PI(base=StaticBalance())


def from_the_middle(**settings):
    """A run around 4 mm, where the vanes are free."""
    start = {"start": control.balanced_at(0.004), "duty_before": 51.0}
    return Scenario(**{"reference": WAVE, **start, **settings})


def test_a_constant_duty_is_an_ordinary_simulation():
    trace = duty_trace((60, 0.501), p_res=2.0e4)
    time, position = trace.time, np.full_like(trace.time, 0.002)
    trace = trace.replace(p_res=2e4 + 8e3 * time, p_trb=5e4 * time, x_d=position, atmosphere=1e5)
    scenario = Scenario(
        control.Constant(0.0),
        turbine=control.Sampled.through(trace.time, trace.p_trb),
        reservoir=control.Sampled.through(trace.time, trace.p_res),
        start=trace.start(),
        duty_before=60.0,
        ambient_shift=1e5 - 101_013.0,
    )
    plant = vgtjax.Actuator(friction=vgtjax.AdaptiveLuGre())
    plant = vgtjax.replace_parameters(plant, {"friction.load": jnp.full_like(plant.friction.load, 10.0)})
    run, solution = close_loop(plant, ConstantDuty(60.0), scenario, 0.5), vgtjax.simulate(plant, trace)
    np.testing.assert_allclose(run.time, solution.time, atol=1e-15)
    assert np.ptp(solution.x_d) > 1e-3
    without_turbine = vgtjax.simulate(plant, trace.replace(p_trb=None))
    assert np.max(np.abs(without_turbine.x_d - solution.x_d)) > 1e-5
    # Rounding alone: the intervals of a trace are differences of its times.
    np.testing.assert_allclose(run.position, solution.x_d, atol=1e-13)
    np.testing.assert_allclose(run.pressure, solution.p_act, atol=1e-6)
    np.testing.assert_allclose(run.velocity, solution.v_d, atol=1e-11)
    np.testing.assert_array_equal(run.measured.position, run.position)
    np.testing.assert_allclose(run.measured.reservoir, trace.p_res, rtol=1e-12)
    np.testing.assert_allclose(run.measured.ambient, 1e5)


def test_the_duty_is_saturated_and_held_between_samples(actuator):
    scenario = from_the_middle(reference=Sine(amplitude=0.003, rate=20.0, offset=0.004))
    run = close_loop(actuator, PI(proportional_gain=40_000.0), scenario, SHORT, period=1e-2)
    assert np.min(run.command) < 0
    assert np.max(run.command) > 100
    np.testing.assert_array_equal(run.duty, np.clip(run.command, 0, 100))
    # The same duties, each for ten samples of a millisecond.
    held = np.repeat(np.asarray(run.duty)[:-1], 10)
    trace = duty_trace((51.0, len(held) * 1e-3), p_res=2.0e4)
    drive = jax.tree.map(jnp.asarray, trace.replace(pwm=held).drive())
    before = dataclasses.replace(jax.tree.map(lambda leaf: leaf[0], drive), pwm=jnp.asarray(51.0))
    state = actuator.start(scenario.start, before)
    states, _ = vgtjax.FixedStep().plan(actuator, trace)(actuator, state, drive, diffrax.ForwardMode())
    np.testing.assert_allclose(run.position[:-1], states.rod.body.position[::10], atol=1e-13)


def test_what_the_controller_logs_and_measures_comes_back(actuator):
    run = close_loop(actuator, Knocker(PID()), from_the_middle(sensors=Sensors.bench()), SHORT)
    count = round(SHORT / 1e-3) + 1
    assert {name: value.shape for name, value in run.log.items()} == {
        name: (count,) for name in ("integral", "velocity", "pulse")
    }
    # Five standard errors of a deviation from 401 samples.
    assert np.std(run.measured.position - run.position) == pytest.approx(8e-6, rel=5 / (2 * count) ** 0.5)
    assert np.std(run.measured.reservoir) == pytest.approx(60.0, rel=5 / (2 * count) ** 0.5)
    np.testing.assert_allclose(run.reference.velocity, 0.02 * np.cos(20 * np.asarray(run.time)), atol=1e-12)
    np.testing.assert_allclose(run.error, run.reference.position - run.position)


CONTROLLERS = {
    "PID": Knocker(PID(PI(proportional_gain=40_000.0, base=StaticBalance()))),
    "compensation": control.FrictionCompensation(),
}
GAINS = {
    "PID": [
        "amplitude",
        "controller.derivative_gain",
        "controller.differentiator.filter_time",
        *(f"controller.pi.{gain}" for gain in ("proportional_gain", "integral_gain", "tracking_time")),
        *(f"controller.pi.base.{part}" for part in ("diaphragm.stiffness", "converter.actuator_area")),
    ],
    "compensation": ["proportional_gain", "derivative_gain", "observer_gain", "load"],
}


def costs(name, actuator, adjoint=None):
    """Tracking error in mm as a function of the controller's gains and of two numbers of the plant, all relative."""
    controller, plant = CONTROLLERS[name], ["diaphragm.stiffness", "friction.coulomb_force"]
    # Large enough to saturate now and then, so that anti-windup counts.
    scenario = from_the_middle(reference=Sine(amplitude=0.002, rate=25.0, offset=0.004))

    def scaled(module, names, factors):
        return vgtjax.replace_parameters(
            module, {n: vgtjax.get_parameter(module, n) * f for n, f in zip(names, factors, strict=True)}
        )

    def cost(factors):
        tuned = scaled(controller, GAINS[name], factors[: len(GAINS[name])])
        varied = scaled(actuator, plant, factors[len(GAINS[name]) :])
        run = close_loop(varied, tuned, scenario, SHORT, adjoint=adjoint, throw=False)
        return 1e3 * control.tracking_rms(run, 0.05)

    return cost, jnp.ones(len(GAINS[name]) + len(plant))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_gradients_are_central_differences(name, actuator):
    cost, point = costs(name, actuator)
    forward = jax.jit(jax.jacfwd(cost))(point)
    step = 1e-5
    steps = step * jnp.concatenate([jnp.eye(len(point)), -jnp.eye(len(point))])
    above, below = jnp.split(jax.jit(jax.vmap(lambda by: cost(point + by)))(steps), 2)
    # Measured: 1e-7, of which rounding is the larger part; a kink that is crossed within the step adds some.
    np.testing.assert_allclose(forward, (above - below) / (2 * step), rtol=2e-6)
    assert np.all(np.abs(forward) > 1e-5)


def test_reverse_mode_gives_the_same_gradient_and_keeps_a_part_of_the_run_only(actuator):
    cost, point = costs("PID", actuator)
    backward = jax.jit(jax.grad(costs("PID", actuator, REVERSE)[0])).lower(point).compile()
    np.testing.assert_allclose(backward(point), jax.jit(jax.jacfwd(cost))(point), rtol=1e-8, atol=1e-10)
    # Plain reverse mode (DirectAdjoint) keeps some 2500 bytes a sample, checkpoints 260 here and less in longer runs.
    assert backward.memory_analysis().temp_size_in_bytes < 600 * round(SHORT / 1e-3)


def test_a_batch_of_plants_gains_and_scenarios_is_its_members(actuator):
    def run(stiffness, gain, key, amplitude):
        plant = eqx.tree_at(lambda a: a.diaphragm.stiffness, actuator, stiffness)
        reference = Sine(amplitude, rate=20.0, offset=0.004)
        scenario = from_the_middle(reference=reference, sensors=Sensors.bench(), key=key)
        return close_loop(plant, PI(gain, base=StaticBalance()), scenario, SHORT, throw=False).position

    members = (
        jnp.array([11_000.0, 12_000.0, 13_000.0]),
        jnp.array([2000.0, 4000.0, 6000.0]),
        jax.random.split(jax.random.key(3), 3),
        jnp.array([0.001, 0.002, 0.0015]),
    )
    batch = jax.jit(jax.vmap(run))(*members)
    single = jax.jit(run)
    for lane in range(3):
        # Vector code rounds differently, and noise that meets a stop or an orifice lets rounding grow.
        np.testing.assert_allclose(batch[lane], single(*(each[lane] for each in members)), atol=1e-12)


def test_a_failed_plant_is_flagged_and_leaves_the_others_alone(actuator):
    def run(mass):
        plant = eqx.tree_at(lambda a: a.diaphragm.mass, actuator, mass)
        return close_loop(plant, SIMPLE, from_the_middle(), SHORT, throw=False)

    runs = jax.jit(jax.vmap(run))(jnp.array([0.63, -0.63, 0.63]))
    failed = np.asarray(runs.result != vgtjax.RESULTS.successful)
    assert failed.tolist() == [False, True, False]
    np.testing.assert_array_equal(runs.position[0], runs.position[2])
    assert np.all(np.isfinite(runs.position[0]))
    with pytest.raises(RuntimeError, match=r"The diaphragm swallows the chamber: enlarge chamber.volume"):
        close_loop(vgtjax.replace_parameters(actuator, {"chamber.volume": 1e-6}), SIMPLE, from_the_middle(), SHORT)


def test_a_controller_that_asks_for_no_number_has_failed(actuator):
    silent = eqx.tree_at(lambda pi: pi.proportional_gain, SIMPLE, jnp.asarray(jnp.nan))
    run = close_loop(actuator, silent, from_the_middle(), SHORT, throw=False)
    assert run.result == vgtjax.RESULTS.diverged


def test_the_precision_is_that_of_the_plant(actuator):
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), actuator)
    scenario = from_the_middle(sensors=Sensors.bench())
    run = close_loop(single, SIMPLE, scenario, SHORT)
    assert {leaf.dtype for leaf in jax.tree.leaves(run) if eqx.is_inexact_array(leaf)} == {np.dtype(np.float32)}
    # Another precision draws other noise, so only the means agree: to 8 um of noise through a slow plant.
    double = close_loop(actuator, SIMPLE, scenario, SHORT)
    np.testing.assert_allclose(run.position, double.position, atol=5e-5)


def test_impossible_runs_are_refused(actuator):
    scenario = from_the_middle()
    with pytest.raises(vgtjax.InputError, match="period must be positive and at most the duration, but they are 0"):
        close_loop(actuator, PI(), scenario, 1.0, period=0.0)
    with pytest.raises(vgtjax.InputError, match=r"at most the duration, but they are 0\.001 s and 0\.0 s"):
        close_loop(actuator, PI(), scenario, 0.0)
    with pytest.raises(vgtjax.InputError, match=r"driven by the duty alone, but MechanicalActuator needs p_act"):
        close_loop(vgtjax.MechanicalActuator(), PI(), scenario, 1.0)
    with pytest.raises(vgtjax.InputError, match="adjoint must be ForwardMode"):
        close_loop(actuator, PI(), scenario, SHORT, adjoint=diffrax.BacksolveAdjoint())


def test_figures_of_merit_count_from_the_settling_time(actuator):
    run = close_loop(actuator, SIMPLE, from_the_middle(), SHORT)
    late = np.asarray(run.time) >= 0.1
    error, duty = np.asarray(run.error)[late], np.asarray(run.duty)
    assert float(control.tracking_rms(run, 0.1)) == pytest.approx(np.sqrt(np.mean(error**2)))
    assert float(control.tracking_peak(run, 0.1)) == pytest.approx(np.max(np.abs(error)))
    assert float(control.tracking_rms(run)) != float(control.tracking_rms(run, 0.1))
    assert float(control.effort(run, 0.1)) == pytest.approx(np.sqrt(np.mean(duty[late] ** 2)))
    assert float(control.chatter(run, 0.1)) == pytest.approx(np.sqrt(np.mean(np.diff(duty)[late[1:]] ** 2)))
