"""Control from the position alone where the sensor is biased or fails, and where a reference lies beyond the stops."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import control
from vgtjax.control import LoadBackstepping, LostSensor, Scenario, Sensor, Sensors, StuckSensor, WithFallback


@pytest.fixture(scope="module")
def controller(actuator):
    return LoadBackstepping.for_plant(actuator)


def biased(offset):
    """The bench's sensors, the position's off by so many m."""
    return dataclasses.replace(Sensors.bench(), position=Sensor(offset=jnp.asarray(offset), noise=8e-6))


@pytest.mark.parametrize("offset", [-1e-4, 1e-4])
def test_a_biased_sensor_takes_no_force_of_the_stop_for_load(actuator, controller, offset):
    """It shows the rod off its stop, where the spring presses with 46 N for three seconds before the step."""
    run = control.close_loop(actuator, controller, Scenario(control.signal_2(), sensors=biased(offset)), 6.0)
    assert np.max(np.abs(run.log["load"])) < 15.0  # of the 46 N some act while the rod counts as half free
    time, shown = np.asarray(run.time), np.asarray(run.error) - offset
    # It settles as without a bias, of which nothing is known: the rod is wrong by that.
    assert np.max(np.abs(shown[time > 4.0])) < 5e-5


@pytest.mark.parametrize("offset", [5e-5, 7e-5])
def test_a_bias_that_only_undoes_how_far_a_rod_at_rest_sinks_in_is_noticed(actuator, controller, offset):
    """The preload presses it 49 um into its stop, so that the sensor shows it near zero."""
    run = control.close_loop(actuator, controller, Scenario(control.signal_2(), sensors=biased(offset)), 5.0)
    # Half of the 46 N act where the rod counts as half free. Measured: 17 N; 34 N on plants when it went unnoticed.
    assert np.max(np.abs(run.log["load"])) < 23.0
    time, shown = np.asarray(run.time), np.asarray(run.error) - offset
    assert np.max(np.abs(shown[time > 4.0])) < 5e-5


@pytest.mark.parametrize("design", [LoadBackstepping, control.FrictionCompensation, control.AdaptiveBackstepping])
@pytest.mark.parametrize("beyond", [0.014, -0.002])
def test_a_reference_beyond_the_stops_leaves_nothing_behind(actuator, design, beyond):
    """Two seconds of it: what integrates or observes is back within half a second."""
    asked = control.Steps(jnp.array([0.2, 2.2]), jnp.array([beyond, 0.005]), 0.005, 0.02)
    start = {"start": control.balanced_at(0.005), "duty_before": 57.0}
    run = control.close_loop(actuator, design.for_plant(actuator), Scenario(asked, **start), 3.2)
    assert np.all(np.isfinite(run.command))
    assert np.max(np.abs(run.error[run.time > 2.8])) < 5e-5


@pytest.mark.parametrize("fault", [LostSensor("position", 3.0, 3.5), StuckSensor("position", 3.0, 3.5)])
def test_after_a_fault_it_follows_again(actuator, controller, fault):
    """The balance holds the rod meanwhile; what was known before is good enough to go on with."""
    guarded = WithFallback.for_plant(actuator, controller=controller)
    run = control.close_loop(
        actuator, guarded, Scenario(control.signal_1(), sensors=Sensors.bench(), disturbances=(fault,)), 4.5
    )
    time, error = np.asarray(run.time), np.abs(np.asarray(run.error))
    assert np.max(error[(time >= 3.0) & (time < 3.5)]) < 5e-4
    assert np.max(error[time > 3.8]) < 5e-5
