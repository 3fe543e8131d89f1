"""Derivatives of the adaptive closed loop with respect to every gain, as long as it remembers."""

import jax
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import AdaptiveBackstepping, DesignModel, Scenario, Sensor, Sensors
from vgtjax.control.observers._friction_observer import nominal_coefficients
from vgtjax.tuning import gain_names, soften

SECONDS = 10.0
GAINS = tuple(gain_names(AdaptiveBackstepping()))
STEP = 1e-6
"""Of a factor on a gain. A longer one straddles kinks: with 1e-4, differences of some gains are off by a hundredth."""


def loop(actuator, amplitude=0.003, rate=2.0):
    """A run under noise that slides and turns, as the tuner softens it, over factors of the gains."""
    controller, plant = soften(AdaptiveBackstepping()), soften(actuator)
    bench = Sensors.bench()
    # Nothing is rounded: what is has no differences.
    sensors = Sensors(Sensor(bench.position.noise), Sensor(bench.pressure.noise), Sensor(bench.reservoir.noise))
    scenario = Scenario(
        control.Sine(amplitude, rate, 0.005),
        sensors=sensors,
        start=control.balanced_at(0.005),
        duty_before=55.0,
        key=jax.random.key(3),
    )

    def run(factors):
        values = {n: vgtjax.get_parameter(controller, n) * f for n, f in zip(GAINS, factors, strict=True)}
        return control.close_loop(plant, vgtjax.replace_parameters(controller, values), scenario, SECONDS, throw=False)

    return run


@pytest.fixture(scope="module")
def errors(actuator):
    """Derivatives of the error in um at every sample with respect to a factor on each gain, and central differences."""
    run, unit = loop(actuator), np.eye(len(GAINS))
    factors = 1 + STEP * np.concatenate([0 * unit, unit, -unit])

    @jax.jit
    @jax.vmap
    def along(at, direction):
        return jax.jvp(lambda factors: 1e6 * run(factors).error, (at,), (direction,))

    values, slopes = (np.asarray(each) for each in along(factors, np.tile(unit, (3, 1))))
    _, upper, lower = np.split(values, 3)
    return np.split(slopes, 3)[0], (upper - lower) / (2 * STEP)


@pytest.mark.parametrize("name", GAINS)
def test_derivatives_of_a_noisy_run_are_central_differences_in_every_second(errors, name):
    slope, difference = (np.split(each[GAINS.index(name), 1:], round(SECONDS)) for each in errors)
    for mine, theirs in zip(slope, difference, strict=True):
        size = np.linalg.norm(mine)
        # Measured: 1e-6 to 1e-4; rounding of the run, 1e-10 um, over the step is what is left.
        assert np.linalg.norm(mine - theirs) < 1e-3 * size
        # A gain that nothing depends on would give a zero.
        assert size > 1e-6


def test_this_is_as_long_as_the_loop_remembers(actuator):
    """But for coefficients of friction, a force that is learned is the slowest: `k2` over `gamma_d`."""
    controller, model = AdaptiveBackstepping(), DesignModel()
    k2 = controller.velocity_gain + nominal_coefficients(model)[1]
    load = (k2 + controller.position_weight / controller.position_gain) / controller.load_gain
    drift = controller.pressure_gain / controller.drift_gain
    assert max(float(load), float(drift)) < SECONDS / 3
