"""A noisy loop differentiated with respect to every gain of backstepping, and a knot of its observer's map."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control, fit_flow_map
from vgtjax.control import Backstepping, DesignModel, Motion, ObservedState, PressureObserver, Scenario
from vgtjax.parts import SteadyPlungerFlow

GAINS = ["position_gain", "velocity_gain", "pressure_gain"]
GAINS += [f"observer.{name}" for name in ("friction_rate", "pressure_rate", "injection_rate")]


@pytest.fixture(scope="module")
def flow_map(actuator) -> SteadyPlungerFlow:
    return fit_flow_map(actuator).flow_map


def test_the_step_of_the_observer_does_not_jump_where_the_plunger_closes(actuator, flow_map):
    observer = PressureObserver(DesignModel.for_plant(actuator, flow_map))
    duty, zero = jnp.asarray(62.0), jnp.asarray(0.0)
    closed = float(np.polynomial.Polynomial(np.asarray(flow_map.equilibrium))(62.0))
    motion = Motion(jnp.asarray(0.007), jnp.asarray(0.002), jnp.asarray(101_013.0))

    @jax.jit
    @jax.vmap
    def onward(pressure):
        return observer.step(ObservedState(zero, zero, pressure), motion, duty, 1e-3)[0].pressure

    offsets = 1e-3 * np.arange(-3, 4)
    found = np.asarray(onward(closed + offsets))
    # The step passes differences of the start on, and decays; the jump of a tangent at the knot makes 8 Pa of these.
    assert np.all(np.diff(found) > 0)
    assert np.max(np.diff(found)) < 1.01e-3


def test_gradients_of_a_noisy_loop_are_central_differences(actuator, flow_map):
    controller = Backstepping(observer=PressureObserver(DesignModel.for_plant(actuator, flow_map)))
    # Noise of the sensors, which meets every kink. Rounded readings would make a staircase of the cost.
    sensors = control.Sensors(*(control.Sensor(noise) for noise in (8e-6, 60.0, 60.0)))
    reference = control.Sine(0.002, 5.0, 0.005)
    scenario = Scenario(reference, sensors=sensors, start=control.balanced_at(0.005), duty_before=55.0)

    def cost(factors):
        values = {name: vgtjax.get_parameter(controller, name) * f for name, f in zip(GAINS, factors, strict=True)}
        tuned = vgtjax.replace_parameters(controller, values)
        run = control.close_loop(actuator, tuned, scenario, 1.0, throw=False)
        return 1e6 * control.tracking_rms(run, 0.3)

    step, unit = 1e-6, np.eye(len(GAINS))
    factors = 1 + np.concatenate([0 * unit, step * unit, -step * unit])
    directions = np.tile(unit, (3, 1))
    batch = jax.jit(jax.vmap(lambda at, along: jax.jvp(cost, (at,), (along,))))
    values, slopes = (np.asarray(each).reshape(3, -1) for each in batch(jnp.asarray(factors), jnp.asarray(directions)))
    # Rounding of 60 um over the step, and kinks that it straddles.
    np.testing.assert_allclose(slopes[0], (values[1] - values[2]) / (2 * step), rtol=1e-4, atol=1e-6)
    assert np.all(np.abs(slopes[0]) > 1e-2)
