"""Derivatives of the loop that learns the load with respect to every gain, over two seconds."""

import jax
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import LoadBackstepping, Scenario, Sensor, Sensors
from vgtjax.tuning import gain_names

SECONDS, PARTS = 2.0, 4
"""s, and parts of it that are compared each by itself: what the start teaches fades in the first."""
GAINS = tuple(gain_names(LoadBackstepping()))
STEP = 1e-6
"""Of a factor on a gain."""


@pytest.fixture(scope="module")
def errors(actuator):
    """Derivatives of the error in um at every sample with respect to a factor on each gain, and central differences."""
    controller, unit = LoadBackstepping(), np.eye(len(GAINS))
    # Noise of the sensors, which meets every kink; nothing is rounded, as what is has no differences.
    sensors = Sensors(*(Sensor(noise) for noise in (8e-6, 60.0, 60.0)))
    start = {"start": control.balanced_at(0.005), "duty_before": 55.0}
    scenario = Scenario(control.Sine(0.001, 10.0, 0.005), sensors=sensors, **start)

    def error(factors):
        values = {n: vgtjax.get_parameter(controller, n) * f for n, f in zip(GAINS, factors, strict=True)}
        tuned = vgtjax.replace_parameters(controller, values)
        return 1e6 * control.close_loop(actuator, tuned, scenario, SECONDS, throw=False).error

    factors = 1 + STEP * np.concatenate([0 * unit, unit, -unit])
    batch = jax.jit(jax.vmap(lambda at, along: jax.jvp(error, (at,), (along,))))
    values, slopes = (np.asarray(each) for each in batch(factors, np.tile(unit, (3, 1))))
    _, upper, lower = np.split(values, 3)
    return np.split(slopes, 3)[0], (upper - lower) / (2 * STEP)


def test_these_are_all_gains():
    assert len(GAINS) == 10
    assert "differentiator.largest_second_derivative" in GAINS
    assert "observer.load_variation" in GAINS


@pytest.mark.parametrize("name", GAINS)
def test_derivatives_of_a_noisy_run_are_central_differences_in_every_half_second(errors, name):
    slope, difference = (np.split(each[GAINS.index(name), 1:], PARTS) for each in errors)
    for mine, theirs in zip(slope, difference, strict=True):
        size = np.linalg.norm(mine)
        # Measured: 2e-8 to 7e-4, the largest of the pressure's drift, which hardly matters: rounding over the step.
        assert np.linalg.norm(mine - theirs) < 3e-3 * size
        # A gain that nothing depends on would give a zero; that drift gives 0.05 um.
        assert size > 1e-3
