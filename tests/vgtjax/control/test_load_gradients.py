"""Derivatives of the loop that learns the load with respect to every gain, as long as it remembers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import AbstractController, LoadBackstepping, Scenario, Sensor, Sensors
from vgtjax.tuning import gain_names

SECONDS = 24
"""s; three times the slowest time constant of what it learns along this sine, 7 to 8 s, that of the friction level."""
GAINS = tuple(gain_names(LoadBackstepping()))
STEP = 1e-6
"""Of a factor on a gain."""
ROUNDING = 1e-11
"""um; the last digit of a position of 8 mm is 2e-12 um, and runs that are rounded differ by 1e-12 to 4e-12 um."""
WRONG = np.diag([1.0, 0.1])
"""N and parts; a load and a friction level that are wrong at the start, one per row."""


class Misled(AbstractController):
    """A controller whose load and friction level are wrong at the start."""

    wrong: jax.Array
    inner: LoadBackstepping = eqx.field(default_factory=LoadBackstepping)

    @property
    def observes(self):
        return self.inner.observes

    def initial_state(self, measurement):
        state = self.inner.initial_state(measurement)
        return eqx.tree_at(lambda s: s.estimate.mean, state, state.estimate.mean.at[3:].add(self.wrong))

    def update(self, state, measurement, reference, period):
        return self.inner.update(state, measurement, reference, period)


@pytest.fixture(scope="module")
def close(actuator):
    """A run under noise that slides and turns, of some controller."""
    # Noise of the sensors, which meets every kink; nothing is rounded, as what is has no differences.
    sensors = Sensors(*(Sensor(noise) for noise in (8e-6, 60.0, 60.0)))
    start = {"start": control.balanced_at(0.005), "duty_before": 55.0}
    scenario = Scenario(control.Sine(0.003, 2.0, 0.005), sensors=sensors, **start)
    return lambda controller: control.close_loop(actuator, controller, scenario, float(SECONDS), throw=False)


@pytest.fixture(scope="module")
def errors(close):
    """Derivatives of the error in um at every sample with respect to a factor on each gain, and central differences."""
    controller, unit = LoadBackstepping(), np.eye(len(GAINS))

    def error(factors):
        values = {n: vgtjax.get_parameter(controller, n) * f for n, f in zip(GAINS, factors, strict=True)}
        return 1e6 * close(vgtjax.replace_parameters(controller, values)).error

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
def test_derivatives_of_a_noisy_run_are_central_differences_in_every_second(errors, name):
    slope, difference = (np.split(each[GAINS.index(name), 1:], SECONDS) for each in errors)
    for mine, theirs in zip(slope, difference, strict=True):
        size = np.linalg.norm(mine)
        # Measured: rounding over the step is all, 2e-8 of most gains and up to 3e-3 of the pressure's drift, which
        # hardly matters.
        assert np.linalg.norm(mine - theirs) < 1e-4 * size + np.sqrt(mine.size) * ROUNDING / STEP
        # A gain that nothing depends on would give a zero; that drift gives 0.02 um.
        assert size > 1e-3


def test_this_is_as_long_as_the_loop_remembers(close):
    """A load or a friction level that was wrong at the start is forgotten before the end, and not at once."""

    def learned(wrong):
        log = close(Misled(wrong)).log
        return jnp.stack([log["load"], log["level"]], axis=1)

    along = jax.jit(jax.vmap(lambda direction: jax.jvp(learned, (jnp.zeros(2),), (direction,))[1]))
    left = np.abs(np.asarray(along(WRONG))) / WRONG.sum(0)
    begun, half, end = (
        np.max(left[:, 1000 * second : 1000 * (second + 1)]) for second in (1, SECONDS // 2, SECONDS - 1)
    )
    # Measured: parts of 0.024, 0.0032 and 0.0008, which is a time constant of 7.8 s.
    assert end < 0.01 < begun
    assert (SECONDS / 2 - 1) / np.log(half / end) < SECONDS / 2.5
