"""Whether a tuned observer that switches slides: what its own closed loops say of it."""

import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import PI, Backstepping, PressureObserver, Sine
from vgtjax.tuning import Objective, conditions, conditions_asked, cross_cases, plan_tuning, sliding

SETTLED = 0.1
WHERE = "observer.switching_gain"
BOUND = "observer.switching_gain above its bound [5.16]"


def switching(gain, **settings):
    return Backstepping(observer=PressureObserver(switching_gain=gain, **settings))


@pytest.fixture(scope="module")
def problem(actuator):
    """A plant whose preload is not as the observer believes, so that it is wrong about the pressure."""
    plants = {name: vgtjax.replace_parameters(actuator, {"diaphragm.preload": p}) for name, p in PRELOADS.items()}
    cases = cross_cases(plants, {"sine": Sine(0.002, 10.0, 0.005)}, duration=0.3)
    return plan_tuning(switching(1.24), cases, Objective(settled=SETTLED), free=["position_gain"])


PRELOADS = {"printed": 49.46, "stiff": 58.0}
"""N"""


@pytest.fixture(scope="module")
def costs(problem):
    return problem.evaluate(problem.start)


def test_the_error_of_the_observed_pressure_is_that_of_the_run(problem, costs):
    runs = problem.simulate(problem.start, range(2))
    late = np.asarray(runs.time[0]) >= SETTLED
    missed = np.abs(np.asarray(runs.pressure - runs.log["pressure"]))[:, late]
    # The same numbers, of a program that is compiled with other results: rounding of 1e5 Pa.
    np.testing.assert_allclose(costs.pressure_peak, missed.max(1), rtol=1e-6)
    assert costs.pressure_peak[1] > 1.5 * costs.pressure_peak[0]


def test_a_gain_slides_above_what_the_worst_closed_loop_needs(problem, costs):
    """`A_d e4 / m` [5.16], written once more."""
    needed = 2.9224e-3 * costs.pressure_peak[1] / 0.63
    for gain, slides in ((0.5 * needed, False), (1.01 * needed, True)):
        found = sliding(switching(gain), (problem.cases, costs), settled=SETTLED)
        assert found.slides is slides
        assert found.case == "stiff, sine, 0 mbar"
        # The area is printed with five digits.
        assert found.needed == pytest.approx(needed, rel=1e-3)
        assert f"{WHERE} is {gain:.3g} m/s2" in found.sentence
        assert ("does not slide" in found.sentence) is not slides
        assert f"{costs.pressure_peak[1]:.4g} Pa from 0.1 s on in 'stiff, sine, 0 mbar'" in found.sentence


def test_of_several_groups_of_closed_loops_the_worst_counts(problem, costs):
    first, second = problem.cases.take([0]), problem.cases.take([1])
    judged = [(first, _only(costs, [0])), (second, _only(costs, [1]))]
    found = sliding(switching(1.24), *judged, settled=SETTLED)
    assert found == sliding(switching(1.24), (problem.cases, costs), settled=SETTLED)
    failed = _only(costs, [1], nan=True)
    assert sliding(switching(1.24), judged[0], (second, failed), settled=SETTLED).case == "printed, sine, 0 mbar"
    assert sliding(switching(1.24), (second, failed), settled=SETTLED) is None


def _only(costs, places, nan=False):
    fields = (costs.terms, costs.rms, costs.peak, costs.pressure_peak, costs.failed)
    terms, rms, peak, pressure, failed = (each[places] for each in fields)
    return type(costs)(terms, rms, peak, np.full_like(pressure, np.nan) if nan else pressure, failed)


@pytest.mark.parametrize("controller", [switching(0.0), PI()], ids=["smooth", "no observer"])
def test_what_does_not_switch_needs_not_slide(problem, costs, controller):
    assert sliding(controller, (problem.cases, costs), settled=SETTLED) is None


def test_a_bound_for_errors_that_nobody_stated_is_no_condition_that_is_kept():
    assert float(conditions(switching(1.24))[BOUND]) == 1.0
    assert BOUND not in conditions_asked(switching(1.24))
    stated = conditions_asked(switching(40.0, largest_pressure_error=jnp.asarray(6e3)))
    # 40 over 27.8 m/s2, less one.
    assert stated[BOUND] == pytest.approx(0.437, abs=1e-3)
