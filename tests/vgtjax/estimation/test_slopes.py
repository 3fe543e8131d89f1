"""Derivatives over the places that the errors of an end leave possible."""

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax.estimation import LeastSquares, Slopes, Unknown, plan_task, run_alone, start_calibration
from vgtjax.estimation.search._slopes import FARTHEST, NUDGE, places_around


@pytest.fixture(scope="module")
def ended():
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, unknown=Unknown(duty_delay=False, duty_hold=False))
    return run_alone(start_calibration(task).ending())


def test_errors_are_by_derivatives_around_the_end(ended):
    progress, search = ended.minimiser.progress, ended.minimiser
    assert progress.settled
    assert len(progress.around) == len(search.slopes.around) == 4
    moved = np.array(progress.around) - search.slopes.at
    np.testing.assert_allclose(moved[::2], -moved[1::2], atol=1e-12)
    each = [Slopes.find(search.problem, np.array(place)) for place in (search.slopes.at, *progress.around)]
    columns = [search.problem.columns_of(found.columns, found.at) for found in map(run_alone, each)]
    np.testing.assert_allclose(search.point.columns, np.mean(columns, axis=0), rtol=1e-9, atol=1e-9)  # rounding
    assert np.max(np.abs(search.point.columns - columns[0])) > 1e-5  # not one place several times


def test_a_fit_that_is_resumed_has_the_same_derivatives(ended):
    again = start_calibration(ended.task, ended.minimiser.progress)
    np.testing.assert_array_equal(again.minimiser.slopes.at, ended.minimiser.slopes.at)
    # Sensors are learned again of the same residuals: rounding.
    np.testing.assert_allclose(again.minimiser.point.columns, ended.minimiser.point.columns, rtol=1e-9, atol=1e-9)


def test_a_place_that_can_not_be_simulated_is_left_out(ended):
    search = ended.minimiser
    good, bad = np.array(search.progress.around[0]), np.full(len(search.slopes.at), 200.0)
    with np.errstate(over="ignore"):
        found = run_alone(Slopes.find(search.problem, search.slopes.at, [good, bad]))
    expected = run_alone(Slopes.find(search.problem, search.slopes.at, [good]))
    for one, other in zip(found.columns, expected.columns, strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(found.alone.columns, found.evaluated.columns, strict=True):
        np.testing.assert_array_equal(one, other)


def places(covariance, estimable):
    """A thousand pairs about zero."""
    count = len(covariance)
    found = LeastSquares(np.zeros(count), covariance, estimable, np.zeros((0, count)), 1.0, 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vgtjax.estimation.search._slopes.PAIRS", 1000)
        return np.array(places_around(found, np.zeros(count)))


def test_places_have_the_errors_of_the_end():
    """Of units 5 orders apart, of which one is not estimable."""
    mixed = np.random.default_rng(0).normal(size=(4, 4)) * [1e-3, 1e-6, 1e-2, 1e-1]
    covariance = mixed.T @ mixed
    covariance[2] = covariance[:, 2] = 0.0
    moves = places(covariance, np.array([True, True, False, True]))
    expected = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.sqrt(np.mean(moves**2, axis=0)), expected, rtol=0.1)  # four errors of a thousand
    assert np.all(moves[:, 2] == 0.0)


def test_what_is_hardly_known_is_not_moved_far_nor_against_what_is_known():
    """Two entries of which only a difference is known well: to shorten one of them alone would move that."""
    covariance = np.array([[1.0, 0.1], [0.1, 0.01 + 1e-10]])
    moves = places(covariance, np.array([True, True]))
    assert np.sqrt(np.mean(moves[:, 0] ** 2)) == pytest.approx(FARTHEST, rel=0.1)
    distance = np.einsum("ni,ij,nj->n", moves, np.linalg.inv(covariance), moves)
    assert np.mean(distance) < 2.2  # two directions, none farther than its error


def test_where_derivatives_tell_of_nothing_all_is_moved_a_little():
    """They explode there, and a rounding's distance away they may not."""
    moves = places(np.zeros((3, 3)), np.zeros(3, bool))
    np.testing.assert_array_equal(moves[::2], -moves[1::2])
    np.testing.assert_allclose(np.sqrt(np.mean(moves**2, axis=0)), NUDGE, rtol=0.1)  # four errors of a thousand
