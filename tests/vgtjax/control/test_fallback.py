"""A plain mode where the position can't be believed, and no duty that is no number."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import control
from vgtjax.control import PI, LostSensor, Scenario, Sensors, Sine, StaticBalance, StuckSensor, WithFallback, close_loop
from vgtjax.tuning import gain_names

SHORT = 0.3
"""s"""
BALANCED = PI(base=StaticBalance())


def scenario(*disturbances):
    """A run around 4 mm with noisy sensors, disturbed."""
    start = {"start": control.balanced_at(0.004), "duty_before": 51.0, "sensors": Sensors.bench()}
    return Scenario(Sine(0.001, 20.0, 0.004), disturbances=disturbances, **start)


GOOD = scenario()


@pytest.fixture(scope="module")
def guarded(actuator):
    return WithFallback.for_plant(actuator, controller=BALANCED)


def test_a_good_sensor_needs_none(actuator, guarded):
    run, plain = (close_loop(actuator, each, GOOD, SHORT) for each in (guarded, BALANCED))
    np.testing.assert_allclose(run.position, plain.position, atol=1e-10)
    assert not np.any(run.log["fallback"])


@pytest.mark.parametrize(
    ("fault", "noticed"),
    [
        (LostSensor("position", 0.1, 0.2), 0.1),
        (LostSensor("position", 0.1, 0.2, 0.02), 0.1),
        (LostSensor("position", 0.1, 0.2, -0.001), 0.1),
        # The last good sample is 0.099 s; one more than patience is noticed.
        (StuckSensor("position", 0.1, 0.2), 0.15),
    ],
    ids=["no number", "too far", "too near", "stuck"],
)
def test_a_bad_position_is_not_used(actuator, guarded, fault, noticed):
    bad = scenario(fault)
    run = close_loop(actuator, guarded, bad, SHORT)
    time, balance = np.asarray(run.time), close_loop(actuator, guarded.fallback, GOOD, SHORT)
    fallen = np.asarray(run.log["fallback"]) > 0
    np.testing.assert_array_equal(fallen, (time >= noticed - 1e-9) & (time < 0.2 - 1e-9))
    # The balance needs no position; the noise of the reservoir's pressure is the same.
    np.testing.assert_allclose(run.duty[fallen], balance.duty[fallen], atol=1e-9)
    assert float(jnp.max(jnp.abs(run.error))) < 3e-3
    # What the integral was is kept.
    first, last = np.flatnonzero(fallen)[[0, -1]]
    assert run.log["integral"][last + 1] == pytest.approx(float(run.log["integral"][first]), abs=1e-6)


def test_no_measurement_brings_what_is_no_number_into_the_duty(actuator):
    """Every sensor is lost from the first sample on."""
    lost = [LostSensor(channel, 0.0) for channel in ("position", "pressure", "reservoir", "turbine")]
    guarded = WithFallback.for_plant(actuator, controller=control.AdaptiveBackstepping())
    run = close_loop(actuator, guarded, scenario(*lost), 0.05)
    assert np.all(np.isnan(run.measured.position))
    assert np.all(np.isfinite(run.command))
    assert np.all(np.isfinite(run.position))


def test_a_controller_that_answers_no_number_is_started_again(actuator):
    class Moody(control.AbstractController):
        def initial_state(self, measurement):
            return jnp.zeros_like(measurement.position)

        def update(self, state, measurement, reference, period):
            return jnp.where(state > 2.5, jnp.nan, state + 1), 40.0 + state, {"count": state}

    run = close_loop(actuator, WithFallback.for_plant(actuator, controller=Moody()), GOOD, 0.01)
    # Its memory is lost at the fourth sample.
    assert np.asarray(run.log["fallback"]).tolist() == [0, 0, 0, 1] * 2 + [0, 0, 0]
    assert np.all(np.isfinite(run.duty))


def test_its_gains_are_those_of_the_controller(guarded):
    names = gain_names(guarded)
    assert names == [f"controller.{name}" for name in ("proportional_gain", "integral_gain", "tracking_time")]


def test_derivatives_go_through_a_fault(actuator, guarded):
    bad = scenario(LostSensor("position", 0.1, 0.15))

    def error(gain):
        tuned = eqx.tree_at(lambda c: c.controller.proportional_gain, guarded, gain)
        return 1e6 * control.tracking_rms(close_loop(actuator, tuned, bad, SHORT, throw=False))

    compiled = jax.jit(lambda gain: jax.jvp(error, (gain,), (jnp.ones_like(gain),)))
    (_, slope), ends = compiled(jnp.asarray(6000.0)), [compiled(jnp.asarray(6000.0 + move))[0] for move in (50, -50)]
    # Derivatives pass the steps of sensors as if there were none; the cost itself has a tooth for each, of this size.
    assert float(slope) == pytest.approx(float(ends[0] - ends[1]) / 100, rel=0.3)
