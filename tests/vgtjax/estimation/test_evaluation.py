"""What fits ask of the simulator: the same answers alone and many at once."""

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax.estimation import ask, plan_task, run_alone, run_together, side_by_side, start_calibration
from vgtjax.estimation.derivatives import _programs


@pytest.fixture(scope="module")
def questions():
    """Simulations of one trace with parameters that differ by a percent."""
    search = start_calibration(plan_task(vgtjax.Actuator(), [bench(0)], free=FREE)).minimiser
    here, rng = np.array(search.progress.coordinates), np.random.default_rng(2)
    return [search.problem.evaluation(here + 0.01 * rng.normal(size=len(here))) for _ in range(9)]


@pytest.fixture(scope="module")
def alone(questions):
    return [run_alone(ask(each)) for each in questions]


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        for mine, theirs in zip(one.observed, other.observed, strict=True):
            # Rounding of another width; a pressure is 1e5 Pa.
            np.testing.assert_allclose(mine, theirs, rtol=1e-12)


@pytest.mark.parametrize("longest", [0.0, np.inf], ids=["wide", "each on all devices"])
def test_many_at_once_are_as_each_alone(questions, alone, monkeypatch, longest):
    """More than fill a program, in a program for many or one after the other."""
    monkeypatch.setattr(_programs, "LONG", longest)
    monkeypatch.setattr(_programs, "MANY", longest)
    assert_same(run_alone(side_by_side([ask(each) for each in questions])), alone)


def test_fits_side_by_side_get_their_own_answers(questions, alone):
    found = {}
    run_together({number: ask(each) for number, each in enumerate(questions)}, found.__setitem__)
    assert_same([found[number] for number in range(len(questions))], alone)


def test_linear_algebra_that_fails_is_a_failed_fit_which_touches_no_other():
    def bad():
        yield from ()
        return np.linalg.inv(np.zeros((2, 2)))

    def good():
        yield from ()
        return 7

    found = {}
    run_together({"bad": bad(), "good": good()}, found.__setitem__)
    assert found["good"] == 7
    assert str(found["bad"]) == "its linear problem can't be solved (Singular matrix); start elsewhere, or give bounds"
    with pytest.raises(vgtjax.SimulationError, match="its linear problem can't be solved") as caught:
        run_alone(bad())
    assert isinstance(caught.value.__cause__, np.linalg.LinAlgError)
