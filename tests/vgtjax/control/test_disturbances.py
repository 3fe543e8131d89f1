"""What disturbs a loop acts where it should, together as well, and can be differentiated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import (
    PI,
    CoilSupply,
    Constant,
    ConstantDuty,
    Draws,
    LateDuty,
    LostSensor,
    Periodic,
    Ramps,
    Scenario,
    Sine,
    StaticBalance,
    StuckSensor,
    TurbinePulsation,
    close_loop,
)
from vgtjax.exhaust import PressurePulsation
from vgtjax.parts.vane_force import ForcePolynomial

SHORT = 0.3
"""s"""
BALANCED = PI(base=StaticBalance())


def scenario(*disturbances, **settings):
    """A run around 4 mm, disturbed."""
    start = {"start": control.balanced_at(0.004), "duty_before": 51.0}
    return Scenario(**{"reference": Sine(0.001, 20.0, 0.004), **start, **settings}, disturbances=disturbances)


@pytest.fixture(scope="module")
def undisturbed(actuator):
    return close_loop(actuator, BALANCED, scenario(), SHORT)


def test_nothing_that_disturbs_by_nothing_changes_a_run(actuator, undisturbed):
    nothing = (
        LateDuty(0.0),
        CoilSupply.constant(1.0),
        TurbinePulsation.sine(0.0, 33.0),
        StuckSensor("position", 9.0),
        LostSensor("pressure", 9.0),
    )
    run = close_loop(actuator, BALANCED, scenario(*nothing), SHORT)
    # Compiled otherwise: rounding, amplified by friction.
    np.testing.assert_allclose(run.position, undisturbed.position, atol=1e-10)
    np.testing.assert_allclose(run.duty, undisturbed.duty, atol=1e-6)


@pytest.mark.parametrize("delay", [0.004, 0.0045])
def test_a_late_duty_is_the_command_of_before(actuator, delay):
    run = close_loop(actuator, BALANCED, scenario(LateDuty(delay)), SHORT)
    asked = np.concatenate([np.full(8, 51.0), np.clip(run.command, 0.0, 100.0)])
    part = delay / 1e-3 - 4
    expected = (1 - part) * asked[4:-4] + part * asked[3:-5]
    np.testing.assert_allclose(run.duty, expected, atol=1e-9)


def test_a_delay_can_be_differentiated(actuator):
    """A loop that is late follows worse: the derivative is that of differences, between multiples of the period."""

    @jax.jit
    def error(delay):
        run = close_loop(actuator, BALANCED, scenario(LateDuty(delay)), SHORT, throw=False)
        return 1e6 * control.tracking_rms(run)

    at, step = jnp.asarray(0.0035), 1e-6
    slope = jax.jvp(error, (at,), (jnp.ones_like(at),))[1]
    difference = (error(at + step) - error(at - step)) / (2 * step)
    assert float(slope) > 0
    # Differences of a run that sticks and slips are good to some parts in ten thousand.
    assert float(slope) == pytest.approx(float(difference), rel=1e-3)


def test_a_weak_coil_is_a_weak_magnetic_force(actuator):
    """The same run as of a plant whose coefficients are all smaller."""
    weak = vgtjax.replace_parameters(
        actuator, {"converter.magnetic_force": 0.9 * actuator.converter.magnetic_force.coefficients}
    )
    expected = close_loop(weak, BALANCED, scenario(), SHORT)
    run = close_loop(actuator, BALANCED, scenario(CoilSupply.constant(0.9)), SHORT)
    assert np.ptp(np.asarray(run.position)) > 1e-4
    np.testing.assert_allclose(run.position, expected.position, atol=1e-10)


def test_a_supply_may_change_over_time(actuator, undisturbed):
    sagging = Ramps(np.array([0.1, 0.2]), np.array([1.0, 0.8]), rounding=0.01)
    run = close_loop(actuator, BALANCED, scenario(CoilSupply(sagging)), SHORT)
    before = np.asarray(run.time) < 0.09
    np.testing.assert_allclose(run.position[before], undisturbed.position[before], atol=1e-10)
    assert np.max(np.abs(run.position - undisturbed.position)) > 1e-4


def test_only_a_converter_has_a_supply(actuator):
    reduced = vgtjax.plants.StaticMapActuator()
    with pytest.raises(vgtjax.InputError, match="a supply of the coil needs a converter, but Static"):
        close_loop(reduced, ConstantDuty(50.0), scenario(CoilSupply.constant(0.9)), SHORT)


def test_a_coil_pulls_with_the_square_of_its_current():
    """A tenth less voltage is 0.81; copper that has a tenth more resistance the same again as a division."""
    for given, factor in (((12.0, 12.0), 1.0), ((10.8, 12.0), 0.81), ((12.0, 12.0, 0.1 / 3.93e-3), 1 / 1.21)):
        assert float(CoilSupply.for_coil(*given).factor(jnp.asarray(0.0))) == pytest.approx(factor, rel=1e-12)
    for bad in ((0.0, 12.0), (12.0, -1.0), (12.0, 12.0, -300.0)):
        with pytest.raises(vgtjax.InputError, match="needs voltages above zero and a resistance"):
            CoilSupply.for_coil(*bad)


def test_pulsation_is_felt_and_not_seen():
    plant = vgtjax.Actuator(vane_force=ForcePolynomial())
    gas = {"turbine": Constant(1e5)}
    calm = close_loop(plant, BALANCED, scenario(**gas), SHORT)
    run = close_loop(plant, BALANCED, scenario(TurbinePulsation.sine(0.2, 33.0), **gas), SHORT)
    np.testing.assert_array_equal(run.measured.turbine, calm.measured.turbine)
    assert np.max(np.abs(run.position - calm.position)) > 1e-6
    slower = close_loop(plant, BALANCED, scenario(turbine=Sine(2e4, 2 * np.pi * 33.0, 1e5)), SHORT)
    np.testing.assert_allclose(run.position, slower.position, atol=1e-10)


def test_the_pulsation_of_an_engine_keeps_its_shape():
    """A saw tooth a cycle, on a turbine of 1 bar: between least and largest 2 times 15 kPa, and a mean of zero."""
    engine = PressurePulsation(1e5 + np.arange(100.0) * 1e3, 1200.0, cylinders=4, share=0.15)
    share = TurbinePulsation.of(engine).share
    assert float(share.period) == pytest.approx(0.1)
    values = np.asarray(jax.vmap(share)(jnp.arange(100) * 1e-3))
    np.testing.assert_allclose(values, engine.shape(101_013.0), atol=1e-9)
    assert np.ptp(values) == pytest.approx(0.3)


def test_periodic_signals_repeat_and_are_linear_between():
    signal = Periodic(np.array([0.0, 2.0, 1.0, -1.0]), 0.4)
    at = [0.05, 0.45, 0.1, 0.35, 40.15]
    np.testing.assert_allclose([float(signal(jnp.asarray(t))) for t in at], [1.0, 1.0, 2.0, -0.5, 1.5], atol=1e-9)
    with pytest.raises(vgtjax.InputError, match=r"period must be a positive number of seconds, but it is 0\.0"):
        Periodic(np.zeros(4), 0.0)


def test_a_reservoir_sinks_and_sags():
    signal = Draws(2e4, drift=100.0, times=[1.0, 2.0], depth=5e3, recovery=0.5)
    assert float(signal(jnp.asarray(0.5))) == pytest.approx(20_050.0)
    assert float(signal(jnp.asarray(1.0))) == pytest.approx(25_100.0)
    assert float(signal(jnp.asarray(2.0))) == pytest.approx(20_200.0 + 5e3 * (1 + np.exp(-2)))
    assert float(Draws(2e4)(jnp.asarray(3.0))) == 2e4
    with pytest.raises(vgtjax.InputError, match=r"times of draws must be a list, but they are 1\.0; give e\.g\."):
        Draws(2e4, times=1.0)


def test_a_sensor_that_sticks_shows_its_last_value(actuator, undisturbed):
    run = close_loop(actuator, BALANCED, scenario(StuckSensor("position", 0.1, 0.2)), SHORT)
    time, shown = np.asarray(run.time), np.asarray(run.measured.position)
    stuck = (time >= 0.1) & (time < 0.2)
    assert np.all(shown[stuck] == shown[np.flatnonzero(stuck)[0] - 1])
    np.testing.assert_array_equal(shown[~stuck], np.asarray(run.position)[~stuck])


def test_a_sensor_that_is_lost_shows_nothing_or_a_value(actuator):
    lost = LostSensor("reservoir", 0.1, 0.2), LostSensor("pressure", 0.0, value=5e3)
    run = close_loop(actuator, ConstantDuty(51.0), scenario(*lost), SHORT)
    time = np.asarray(run.time)
    np.testing.assert_array_equal(np.isnan(run.measured.reservoir), (time >= 0.1) & (time < 0.2))
    assert np.all(np.asarray(run.measured.pressure) == 5e3)


def test_delays_that_cannot_be_are_refused():
    with pytest.raises(vgtjax.InputError, match=r"must lie between 0 and longest = 0\.02 s, but it is 0\.03 s; raise"):
        LateDuty(0.03)
    with pytest.raises(vgtjax.InputError, match=r"must lie between 0 and longest = 0\.02 s, but it is -0\.001 s"):
        LateDuty(-0.001)


def test_disturbed_scenarios_can_be_batched(actuator):
    def run(delay, factor):
        loop = close_loop(
            actuator, BALANCED, scenario(LateDuty(delay), CoilSupply.constant(factor)), SHORT, throw=False
        )
        return control.tracking_rms(loop)

    delays, factors = jnp.array([0.0, 0.004]), jnp.array([1.0, 0.9])
    together = jax.jit(jax.vmap(run))(delays, factors)
    assert float(together[1]) == pytest.approx(float(run(delays[1], factors[1])), rel=1e-6)
    assert abs(float(together[1] - together[0])) > 1e-5


def test_a_reference_beyond_the_stops_leaves_nothing_behind(actuator):
    """A PI that is asked for 14 mm for 0.4 s follows again at once; without anti-windup it does not."""
    beyond = control.Steps(jnp.array([0.1, 0.5]), jnp.array([0.014, 0.005]), 0.005, 0.02)
    start = {"start": control.balanced_at(0.005), "duty_before": 57.0, "reference": beyond}

    def late(tracking_time):
        pi = PI.for_plant(actuator, tracking_time=tracking_time, integral_gain=60_000.0)
        run = close_loop(actuator, pi, scenario(**start), 0.9)
        assert np.max(run.command) > 150
        return float(control.tracking_rms(run, 0.8))

    assert late(0.1) < 0.3 * late(np.inf)


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.0033])
def test_a_late_duty_has_its_derivative_at_whole_periods_too(delay):
    """Between this delay and the next whole one, the duty is the straight line between two."""
    duties, latest = jnp.asarray([40.0, 30.0, 50.0, 20.0, 60.0, 10.0]), jnp.asarray(70.0)

    def arrives(delay):
        return LateDuty(delay, longest=0.005).arriving(duties, latest, 1e-3)[1]

    step = 1e-6
    slope = (float(arrives(jnp.asarray(delay + step))) - float(arrives(jnp.asarray(delay)))) / step
    assert float(jax.grad(arrives)(jnp.asarray(delay))) == pytest.approx(slope, rel=1e-6)
