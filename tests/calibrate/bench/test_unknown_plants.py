"""The controller for plants that nobody knows, on a few of them at the hard corners; the benchmark has a hundred."""

import numpy as np
import pytest
from support import optimised

import vgtjax
from calibrate.bench.cases.unknown_plants import JUMP, Course, Surroundings, draw, follow
from vgtjax.control import LoadBackstepping

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
    _answered(errors[1])


def test_signal_2_that_jumps_as_printed_half_a_second_later(errors):
    """The same is asked; of the benchmark's hundred plants 65 um were measured half a second later, 98 um above."""
    _answered(errors[2])


def _answered(after):
    assert np.max(after.peak) < 0.1e-3
    assert np.max(after.overshoot) < 0.1e-3
