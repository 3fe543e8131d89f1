"""Errors of slow traces: longer along directions that the sharp model answers less than derivatives promise."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from linear_calibrator import LinearCalibrator
from support import duty_trace

import vgtjax
from vgtjax.estimation import Progress, Unknown, _calibrator, plan_task, run_alone, start_calibration
from vgtjax.estimation.duty import _slow_response
from vgtjax.estimation.duty._slow_response import LEAST, MOST, TOLD, unanswered_directions
from vgtjax.estimation.search._slopes import FARTHEST
from vgtjax.parameters import Transform

COLUMNS = np.random.default_rng(8).normal(size=(40, 4)) @ np.array(
    [[8.0, -7.6, 0.0, 0.0], [0.0, 0.7, 0.0, 0.1], [0.0, 0.0, 6.0, 2.0], [0.0, 0.0, 0.0, 9.0]]
)
"""Of residuals by four logarithms, the first two of which go together."""
NOISE = scipy.linalg.null_space(COLUMNS.T)[:, 0] * np.sqrt(len(COLUMNS) - 4)
"""What is left at an end, of size one."""
END = Progress((0.0,) * 4, corrections=3, around=((0.0,) * 4,))
LOGARITHMS = Transform(np.full(4, True), np.ones(4), np.full(4, -np.inf), np.full(4, np.inf))


def ending(sharp, progress=END, *, columns=COLUMNS, transform=LOGARITHMS, **how):
    return LinearCalibrator(sharp, columns, NOISE, progress, transform, **how)


@pytest.fixture(autouse=True)
def slow(monkeypatch):
    monkeypatch.setattr(_slow_response, "lengthens", lambda model, trace: True)


def covariance(columns):
    return np.linalg.inv(columns.T @ columns)


def mean_move(number, columns=COLUMNS):
    """Of all coordinates, where one is off by its standard error."""
    return covariance(columns)[number] / np.sqrt(covariance(columns)[number, number])


def answering(answer, number=0):
    """Sharp columns that answer the mean move with a value by a part of what derivatives promise, and all that is
    orthogonal to it in full."""
    move = mean_move(number)
    promised = COLUMNS @ move
    return COLUMNS + (answer - 1) * np.outer(promised, promised @ COLUMNS) / (promised @ promised)


@pytest.mark.parametrize("answer", [0.3, 0.8])
def test_errors_are_those_of_the_fixed_point(answer):
    """The best told value first, in closed form: `A^-1 C A^-T` with `A = (J^T J)^-1 J^T dr/dx`."""
    best = int(np.argmin(np.diag(covariance(COLUMNS))))
    sharp = answering(answer, best)
    moves = run_alone(unanswered_directions(ending(sharp)))
    back = np.linalg.inv(covariance(COLUMNS) @ COLUMNS.T @ sharp)
    expected = back @ covariance(COLUMNS) @ back.T
    np.testing.assert_allclose(covariance(COLUMNS) + moves.T @ moves, expected, rtol=1e-5)


def test_errors_of_others_are_those_of_what_the_sharp_model_answers_instead():
    """A move along the best told value is answered as one along others as well, which then have part of its error."""
    best = int(np.argmin(np.diag(covariance(COLUMNS))))
    move, usual = mean_move(best), covariance(COLUMNS)
    instead = 0.4 * move + np.where(np.arange(4) == best, 0.0, [0.03, -0.02, 0.02, -0.01])
    of_move = np.linalg.solve(usual, move)
    instead += (0.4 - of_move @ instead) * move
    back = np.eye(4) + np.outer(instead - move, of_move)
    moves = run_alone(unanswered_directions(ending(COLUMNS @ back)))
    forth = np.linalg.inv(back)
    expected = np.diag(forth @ usual @ forth.T)
    assert np.any(expected > 1.5 * np.diag(usual))
    found = np.diag(usual + moves.T @ moves)
    np.testing.assert_allclose(found, np.maximum(expected, np.diag(usual)), rtol=1e-5)


def test_one_direction_that_two_values_share_is_asked_and_counted_once():
    """Two values of which the traces tell the ratio far better than either; their answers are one."""
    shared = mean_move(0)
    assert shared[1] > 0.99 * np.sqrt(covariance(COLUMNS)[1, 1])
    moves = run_alone(unanswered_directions(ending(answering(0.5, 0))))
    longer = np.sqrt(np.diag(covariance(COLUMNS) + moves.T @ moves) / np.diag(covariance(COLUMNS)))
    # Asked first along the second, which has a hundredth of its direction for itself.
    np.testing.assert_allclose(longer[:2], 2.0, rtol=0.05)
    assert np.all(longer[2:] < 1.5)


def test_no_answer_makes_a_value_undetermined_whatever_chatter_says():
    moves = run_alone(unanswered_directions(ending(answering(0.1), chatter=0.3)))
    first = np.sqrt(np.sum(moves[:, 0] ** 2))
    assert 0.8 / LEAST < first / np.sqrt(covariance(COLUMNS)[0, 0]) < 1.2 / LEAST


def test_an_answer_in_full_or_more_adds_nothing():
    for answer in (1.0, 1.4):
        moves = run_alone(unanswered_directions(ending(answering(answer))))
        # Of the others, whose directions share something with it; and the root of rounding.
        np.testing.assert_allclose(moves.T @ moves, np.zeros((4, 4)), atol=1e-6)


def test_values_that_are_told_well_are_not_asked():
    asked = COLUMNS * 1.01 * np.sqrt(np.max(np.diag(covariance(COLUMNS)))) / TOLD
    calibrator = ending(np.zeros_like(asked), columns=asked)
    assert np.all(calibrator.uncertainty().std_errors < TOLD)
    assert run_alone(unanswered_directions(calibrator)).shape == (0, 4)


def test_a_direction_that_cannot_be_asked_to_both_sides_is_left_as_it_is():
    moves = run_alone(unanswered_directions(ending(0.1 * COLUMNS, fails_beyond=-np.inf)))
    assert moves.shape == (0, 4)


def test_a_direction_along_which_a_value_is_at_its_bound_is_left_as_it_is():
    """Nothing can be asked on that side, and one side alone may have a stop where the other has none."""
    held = Transform(np.full(4, True), np.ones(4), np.full(4, -np.inf), np.zeros(4))
    assert run_alone(unanswered_directions(ending(0.1 * COLUMNS, transform=held))).shape == (0, 4)


def test_places_lie_within_what_a_linear_model_reaches():
    asked = []

    class Noting(LinearCalibrator):
        def corrected(self, progress):
            asked.append(progress.coordinates)
            return (yield from super().corrected(progress))

    run_alone(unanswered_directions(Noting(COLUMNS, COLUMNS, NOISE, END, LOGARITHMS)))
    sizes = np.max(np.abs(asked), axis=1)
    assert np.all(sizes <= FARTHEST + 1e-12)
    errors = np.sqrt(np.einsum("ij,jk,ik->i", asked, COLUMNS.T @ COLUMNS, asked))
    assert np.all(errors <= MOST + 1e-9)
    assert np.max(errors) > 1


@pytest.mark.parametrize(
    ("progress", "unknown"),
    [
        (dataclasses.replace(END, around=()), Unknown()),
        (dataclasses.replace(END, lost=True), Unknown()),
        (dataclasses.replace(END, edges=((0.1,),)), Unknown()),
        (END, Unknown(numerics=False)),
    ],
    ids=["not settled", "lost", "edges", "no numerical errors"],
)
def test_where_nothing_is_corrected_nothing_is_asked(progress, unknown):
    assert run_alone(unanswered_directions(ending(0.1 * COLUMNS, progress, unknown=unknown))).shape == (0, 4)


def test_a_trace_that_is_not_slow_is_believed(monkeypatch):
    monkeypatch.setattr(_slow_response, "lengthens", lambda model, trace: False)
    assert run_alone(unanswered_directions(ending(0.1 * COLUMNS))).shape == (0, 4)


def test_a_calibration_has_it_in_errors_and_budget_and_no_band_has_it(monkeypatch):
    """What traces do not answer leaves them as they are."""
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4)
    run = vgtjax.simulate(vgtjax.Actuator(), trace)
    rng, count = np.random.default_rng(5), len(trace.time)
    seen = trace.replace(x_d=run.x_d + rng.normal(0, 8e-6, count), p_act=run.p_act + rng.normal(0, 60.0, count))
    free = ["diaphragm.stiffness", "diaphragm.preload", "chamber.volume"]
    unknown = Unknown(duty_delay=False, duty_hold=False)
    task = plan_task(vgtjax.Actuator(), [seen], free=free, unknown=unknown)
    ended = run_alone(start_calibration(task).ending())
    before = ended.finish()
    moves = np.diag(before.uncertainty.std_errors) * 3

    def known(calibrator):
        assert calibrator is ended
        return moves
        yield

    monkeypatch.setattr(_calibrator, "unanswered_directions", known)
    found = ended.finish()
    np.testing.assert_allclose(found.uncertainty.std_errors, np.sqrt(10) * before.uncertainty.std_errors, rtol=1e-9)
    np.testing.assert_allclose(found.budget.combined, found.std_errors, rtol=1e-6)
    part = found.budget.moved["derivatives of slow traces"]
    np.testing.assert_allclose(part, 3 * before.std_errors, rtol=1e-6)
    for channel in ("x_d", "p_act"):
        bands = [each.traces[0].channels[channel].error for each in (before, found)]
        # Their covariance is a difference of two that are larger.
        np.testing.assert_allclose(bands[1], bands[0], rtol=1e-6)
