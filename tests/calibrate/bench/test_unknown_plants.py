"""The controller for plants that nobody knows, on a few of them at the hard corners; the benchmark has a hundred."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import optimised

import vgtjax
from calibrate.bench.cases.unknown_plants import JUMP, Course, Surroundings, draw, follow
from vgtjax.control import Constant, LoadBackstepping, Scenario, Sensors, Steps, close_loop

PLANTS = 5
SEED = 40961
"""No benchmark has these plants."""
CORNERS = (
    Course("Signal 1", 3e5, 33.0, late=True),
    Course("Signal 2", 3e5, late=True),
    Course("Signal 2", 3e5, late=True, rise=JUMP),
)
"""Highest turbine pressure, and a duty that is 4 ms late; along Signal 1 the pressure pulsates by 20 % besides."""


@pytest.fixture(scope="module")
def errors():
    controller, plants = LoadBackstepping.for_plant(vgtjax.Actuator()), draw(PLANTS, SEED)
    with optimised():
        return [follow(controller, plants, Surroundings.alike(PLANTS, course.delay), course) for course in CORNERS]


def test_signal_1_over_a_whole_period(errors):
    """What is asked of each disturbance alone, here of both: 0.05 mm RMS, 0.15 mm at the peak (measured: 10 and 65 um);
    the pressure within 1 kPa RMS in the middle and 2.5 kPa nearly everywhere (0.7 and 2.3 kPa, what its maps tell)."""
    along = errors[0]
    assert np.max(along.rms) < 0.05e-3
    assert np.max(along.peak) < 0.15e-3
    assert np.median(along.pressure) < 1000
    assert np.max(along.pressure) < 2500


def test_signal_2_half_a_second_after_its_step(errors):
    """Within 0.1 mm, and no further above it; 53 um of both were measured."""
    assert_answered(errors[1])


def test_signal_2_that_jumps_as_printed_half_a_second_later(errors):
    """The same is asked; of the benchmark's hundred plants 65 um were measured half a second later, 98 um above."""
    assert_answered(errors[2])


def assert_answered(after):
    assert np.max(after.peak) < 0.1e-3
    assert np.max(after.overshoot) < 0.1e-3


def test_what_the_closed_stop_taught_is_soon_forgotten():
    """Two seconds of a reference beyond it, whose force is taken for load; 70 um were measured half a second later, and
    9 um after a second."""
    asked = Steps(jnp.array([0.2, 2.2, 4.2]), jnp.array([0.005, 0.014, 0.005]), 0.0, 0.02)
    controller = LoadBackstepping.for_plant(vgtjax.Actuator())

    @eqx.filter_jit
    def run(plants, keys):
        def lane(plant, key):
            scenario = Scenario(asked, Constant(3e5), sensors=Sensors.bench(), key=key)
            loop = close_loop(plant, controller, scenario, 6.2)
            return loop.time, jnp.abs(loop.error), loop.log["load"]

        return jax.vmap(lane, out_axes=(None, 0, 0))(plants, keys)

    with optimised():
        time, error, load = map(np.asarray, run(draw(PLANTS, SEED), jax.random.split(jax.random.key(SEED), PLANTS)))
    assert np.min(load[:, (time > 4.0) & (time < 4.2)]) > 30.0
    assert np.max(error[:, time > 4.7]) < 0.1e-3
    assert np.max(error[:, time > 5.2]) < 0.05e-3
