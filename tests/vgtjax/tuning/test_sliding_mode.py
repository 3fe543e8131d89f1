"""Whether a tuned observer that switches slides: what its own closed loops say of it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import PI, Backstepping, PressureObserver, Sine
from vgtjax.tuning import Objective, close_loops, conditions, conditions_asked, cross_cases, plan_tuning, sliding

SETTLED = 0.1
PRELOADS = {"printed": 49.46, "stiff": 58.0}
"""N"""
BOUND = "observer.switching_gain above its bound [5.16]"


def switching(gain, **settings):
    return Backstepping(observer=PressureObserver(switching_gain=gain, **settings))


@pytest.fixture(scope="module")
def problem(actuator):
    """The second plant's preload is not as the observer believes, so that it is wrong about the pressure."""
    plants = {name: vgtjax.replace_parameters(actuator, {"diaphragm.preload": p}) for name, p in PRELOADS.items()}
    cases = cross_cases(plants, {"sine": Sine(0.002, 10.0, 0.005)}, duration=0.3)
    return plan_tuning(switching(60.0), cases, Objective(settled=SETTLED), free=["observer.switching_gain"])


@pytest.fixture(scope="module")
def costs(problem):
    """By the gain in m/s2, which the coordinates are."""
    return dict(zip((60.0, 1.24, 0.0), problem.evaluate_all(np.array([[60.0], [1.24], [0.0]]) / 60.0), strict=True))


def test_errors_of_the_observer_are_those_of_the_run(problem, costs):
    runs = problem.simulate(problem.start * 1.24 / 60.0, range(2))
    late = np.asarray(runs.time[0]) >= SETTLED
    missed = np.abs(np.asarray(runs.pressure - runs.log["pressure"]))[:, late]
    # The same numbers, of a program that is compiled with other results: rounding of 1e5 Pa.
    np.testing.assert_allclose(costs[1.24].pressure_peak, missed.max(1), rtol=1e-6)
    held = np.abs(np.asarray(runs.log["velocity_error"]))[:, late] < 1e-13  # rounding, or 1e-7 and more
    np.testing.assert_allclose(costs[1.24].sliding, held.mean(1), atol=1e-12)


def test_a_gain_that_slides_holds_the_velocity_and_a_small_one_does_not(problem, costs):
    """The smooth observer alone never does."""
    assert np.all(costs[60.0].sliding == 1.0)
    assert np.all(costs[1.24].sliding < 0.6)
    assert np.all(costs[0.0].sliding == 0.0)
    for gain, slides in ((60.0, True), (1.24, False)):
        found = sliding(switching(gain), (problem.cases, costs[gain]), settled=SETTLED)
        assert found.slides is slides
        assert f"observer.switching_gain is {gain:.3g} m/s2" in found.sentence
        assert ("does not slide" in found.sentence) is not slides


def test_the_case_that_slides_least_is_named_and_the_largest_error_is_worth_a_gain(problem, costs):
    worse = dataclasses.replace(costs[1.24], sliding=np.array([0.5, 0.25]), pressure_peak=np.array([6e3, 1e3]))
    found = sliding(switching(1.24), (problem.cases, worse), settled=SETTLED)
    assert found.sentence.startswith(
        "the observer does not slide: observer.switching_gain is 1.24 m/s2, and holds the velocity at 25 % of the "
        "samples from 0.1 s on in 'stiff, sine, 0 mbar'; the largest error of its pressure, 6000 Pa, is worth 27.8 m/s2"
    )


def test_of_several_groups_of_closed_loops_the_worst_counts(problem, costs):
    worse = dataclasses.replace(costs[1.24], sliding=np.array([0.5, 0.25]))
    first, second = problem.cases.take([0]), problem.cases.take([1])
    judged = [(first, _only(worse, [0])), (second, _only(worse, [1]))]
    found = sliding(switching(1.24), *judged, settled=SETTLED)
    assert found == sliding(switching(1.24), (problem.cases, worse), settled=SETTLED)
    lost = dataclasses.replace(judged[1][1], sliding=np.array([np.nan]), pressure_peak=np.array([np.nan]))
    assert sliding(switching(1.24), judged[0], (second, lost), settled=SETTLED).case == "printed, sine, 0 mbar"
    assert sliding(switching(1.24), (second, lost), settled=SETTLED) is None


def test_loops_that_are_closed_without_tuning_say_the_same(problem, costs):
    """Each plant with a controller of its own; the largest error is worth what its plant's observer makes of it."""
    loops = close_loops(switching(1.24), problem.cases, settled=SETTLED)
    np.testing.assert_allclose(loops.sliding, costs[1.24].sliding, atol=1e-12)
    np.testing.assert_allclose(loops.pressure_peak, costs[1.24].pressure_peak, rtol=1e-6)
    heavy = vgtjax.replace_parameters(switching(1.24), {"observer.model.diaphragm.mass": 1.26})
    own = {"printed": switching(1.24), "stiff": heavy}
    found, one = (sliding(given, (problem.cases, loops), settled=SETTLED) for given in (own, switching(1.24)))
    assert "stiff" in str(problem.cases.labels[int(np.argmax(loops.pressure_peak))])
    # Twice the mass of the printed one, half the acceleration.
    assert found.worth == pytest.approx(0.5 * one.worth, rel=1e-9)
    assert sliding({**own, "stiff": switching(0.0)}, (problem.cases, loops), settled=SETTLED).case.startswith("printed")


def _only(costs, places):
    fields = (getattr(costs, field.name) for field in dataclasses.fields(costs))
    return type(costs)(*jax.tree.map(lambda leaf: leaf[np.array(places)], tuple(fields)))


@pytest.mark.parametrize("controller", [switching(0.0), PI()], ids=["smooth", "no observer"])
def test_what_does_not_switch_needs_not_slide(problem, costs, controller):
    assert sliding(controller, (problem.cases, costs[0.0]), settled=SETTLED) is None


def test_a_bound_for_errors_that_nobody_stated_is_no_condition_that_is_kept():
    assert float(conditions(switching(1.24))[BOUND]) == 1.0
    assert BOUND not in conditions_asked(switching(1.24))
    stated = conditions_asked(switching(40.0, largest_pressure_error=jnp.asarray(6e3)))
    # 40 over 27.8 m/s2, less one.
    assert stated[BOUND] == pytest.approx(0.437, abs=1e-3)
