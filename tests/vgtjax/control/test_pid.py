"""PI, PID and the knocker: their laws by hand, anti-windup, hunting and what the knocker makes of it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import PI, PID, ConstantDuty, Knocker, Measurement, Reference, Scenario, StaticBalance, close_loop

PERIOD = 1e-3


def respond(controller, positions, target):
    """Commands and log of a controller that measures some positions in m, and a fixed target."""
    zeros = jnp.zeros(len(positions))
    measured = Measurement(jnp.asarray(positions), zeros + 6e4, zeros + 2e4, zeros + 101_013.0, zeros)
    return control.replay(controller, measured, Reference(zeros + target, zeros, zeros, zeros), PERIOD)


def test_a_pi_adds_what_it_has_integrated_before():
    command, log = respond(PI(1000.0, 5000.0, base=ConstantDuty(20.0)), [0.001, 0.003, 0.003], 0.002)
    integral = np.array([0.0, 5000 * 1e-3 * 0.001, 0.0])
    np.testing.assert_allclose(log["integral"], integral, atol=1e-15)
    np.testing.assert_allclose(command, [21 + integral[0], 19 + integral[1], 19 + integral[2]])


def test_back_calculation_stops_the_integral_and_an_infinite_time_does_not():
    held = np.full(2000, 0.0)
    command, log = respond(PI(1000.0, 50_000.0, tracking_time=0.01), held, 0.01)
    # It settles where back-calculation balances integration: k_i e (T_t + period) above the limit.
    assert float(command[-1]) == pytest.approx(100 + 500 * (0.01 + PERIOD), rel=1e-9)
    assert float(log["integral"][-1]) < 100
    _, endless = respond(PI(1000.0, 50_000.0, tracking_time=np.inf), held, 0.01)
    assert float(endless["integral"][-1]) == pytest.approx(500 * 1999e-3)


def test_a_pid_brakes_by_the_measured_velocity_only():
    ramp = 0.001 + 0.02 * PERIOD * np.arange(200)
    pid = PID(PI(0.0, 0.0, base=ConstantDuty(50.0)), derivative_gain=100.0)
    command, log = respond(pid, ramp, 0.004)
    share = 1 - (5 / 6) ** np.arange(200)  # 5 ms of filter, 1 ms of period
    np.testing.assert_allclose(log["velocity"], 0.02 * share, atol=1e-12)
    np.testing.assert_allclose(command, 50 - 2 * share, atol=1e-9)
    kick, _ = respond(pid, np.full(5, 0.001), 0.009)  # the target is far away, and nothing moves
    np.testing.assert_array_equal(kick, 50.0)


def test_the_knocker_pulses_the_way_the_controller_moves():
    """A pulse of 20 ms every 40 ms [5.5], whose sign is that of the motion since the pulse before."""
    falling = np.abs(np.arange(400) - 190) * 1e-6  # the command rises for 190 ms and then falls
    knocker = Knocker(PI(5000.0, 0.0, base=ConstantDuty(50.0)))
    command, log = respond(knocker, falling, 0.0)
    plain, _ = respond(knocker.controller, falling, 0.0)
    # The width of its sign takes 1e-8 from a pulse.
    pulse = np.round(log["pulse"], 7)
    np.testing.assert_allclose(command, plain + pulse)
    assert set(np.unique(pulse)) <= {-2.0, 0.0, 2.0}
    on = pulse != 0
    begins = np.flatnonzero(on[1:] & ~on[:-1]) + 1
    np.testing.assert_array_equal(np.diff(begins), 40)
    assert begins[0] == 20  # as if a pulse had ended at zero
    at_begin = np.concatenate([[0.0], np.asarray(plain)[begins]])
    for number, begin in enumerate(begins[:-1]):
        here = slice(begin, begin + 20)
        np.testing.assert_array_equal(pulse[here], 2 * np.sign(np.asarray(plain)[here] - at_begin[number]))
        np.testing.assert_array_equal(pulse[begin + 20 : begin + 40], 0.0)
    assert 2.0 in pulse[100:200]
    assert -2.0 in pulse[300:]


def test_anti_windup_leaves_saturation_sooner(actuator):
    """A step beyond the travel and back: time in s until the rod comes within 1 mm of the new target."""
    reference = control.Steps(times=[0.1, 1.0], levels=[0.014, 0.004], rise=1e-6)

    def late(tracking_time):
        controller = PI(4000.0, 60_000.0, tracking_time=tracking_time)
        run = close_loop(actuator, controller, Scenario(reference), 3.0, throw=False)
        there = (jnp.abs(run.error) < 1e-3) & (run.time > 1.0)
        return jnp.min(jnp.where(there, run.time, 3.0)) - 1.0, jnp.max(run.duty)

    (quick, slow), duty = jax.jit(jax.vmap(late))(jnp.array([0.05, 1e9]))
    np.testing.assert_array_equal(duty, 100.0)
    assert quick < 0.6 * slow  # measured: 0.24 and 0.91 s


def hunting(static_force, coulomb_force, wrap):
    """Swing of the error in mm during the last 3 of 10 s along a slow ramp that began with a step of 1 mm."""
    friction = {"friction.static_force": static_force, "friction.coulomb_force": coulomb_force}
    plant = vgtjax.replace_parameters(vgtjax.Actuator(), friction)
    reference = control.Ramps(times=[0.1, 0.11, 10.1], levels=[0.004, 0.005, 0.0054], rounding=0.01)
    scenario = Scenario(reference, start=control.balanced_at(0.004), duty_before=51.0)
    controller = wrap(PI(proportional_gain=250.0, integral_gain=200_000.0, base=StaticBalance()))
    run = close_loop(plant, controller, scenario, 10.0, throw=False)
    late = run.time > 7.0
    return 1e3 * (jnp.max(jnp.where(late, run.error, -1.0)) - jnp.min(jnp.where(late, run.error, 1.0)))


def test_friction_makes_a_pi_hunt_and_the_knocker_stops_it():
    """The limit cycle is friction's: without it the same loop comes to rest. Measured: 0.79, 0.003 and 0.044 mm."""
    batch = jax.jit(jax.vmap(lambda s, c: hunting(s, c, lambda controller: controller)))
    rubbing, smooth = batch(jnp.array([3.2, 0.02]), jnp.array([2.8, 0.02]))
    knocked = jax.jit(lambda: hunting(3.2, 2.8, Knocker))()
    assert rubbing > 0.5
    assert smooth < 0.05 * rubbing
    assert knocked < 0.1 * rubbing


def test_gains_are_parameters():
    controller = Knocker(PID(PI(base=StaticBalance())))
    table = vgtjax.parameter_table(controller)
    assert table["amplitude"].symbol == "alpha"
    assert table["controller.pi.integral_gain"].unit == "%/(m s)"
    assert table["controller.pi.base.diaphragm.stiffness"].source == "B.2"
    tuned = vgtjax.replace_parameters(controller, {"controller.pi.integral_gain": 7.0})
    assert float(tuned.controller.pi.integral_gain) == 7.0
    leaves = {leaf.dtype for leaf in jax.tree.leaves(controller)}
    assert leaves == {np.dtype(float)}
    assert all(eqx.is_array(leaf) for leaf in jax.tree.leaves(controller))


def test_pulses_that_overlap_are_refused():
    with pytest.raises(
        vgtjax.InputError,
        match=r"width must be below the interval of 0\.04 s, so that .* is 0\.05; use e\.g\. 0\.02",
    ):
        Knocker(PI(), width=0.05)
