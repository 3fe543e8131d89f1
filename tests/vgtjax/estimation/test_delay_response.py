"""Errors beside a late duty: longer where the sharp model answers a delay less than derivatives promise."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from linear_calibrator import LinearCalibrator
from support import duty_trace

import vgtjax
from vgtjax import FixedStep
from vgtjax.estimation import Progress, Unknown, _calibrator, _finish, plan_task, run_alone, start_calibration
from vgtjax.estimation._least_squares import VAGUE
from vgtjax.estimation.duty._delay_response import LEAST, unanswered
from vgtjax.estimation.errors._bands import spread_of
from vgtjax.parameters import Transform
from vgtjax.parts import with_sharp_seat

COLUMNS = np.random.default_rng(3).normal(size=(12, 3)) @ np.array([[9.0, 0.0, 6.0], [0.0, 9.0, 5.0], [0.0, 0.0, 5.0]])
"""Of residuals by two values and a delay, which go together; errors below are closed forms of it."""
NOISE = scipy.linalg.null_space(COLUMNS.T)[:, 0] * np.sqrt(len(COLUMNS) - 3)
"""What is left at an end, of size one."""
END = Progress((0.0, 0.0, 0.0), late=True, corrections=3, around=((0.0, 0.0, 0.0),))
FREE_TO_MOVE = Transform(np.array([True, False, False]), np.ones(3), np.full(3, -np.inf), np.full(3, np.inf))


def ending(sharp, progress=END, *, columns=COLUMNS, transform=FREE_TO_MOVE, **how):
    return LinearCalibrator(sharp, columns, NOISE, progress, transform, **how)


def inverse(columns):
    return np.linalg.inv(columns.T @ columns)


def mean_move(columns):
    """Of all coordinates, where the delay is off by its standard error."""
    covariance = inverse(columns)
    return covariance[-1] / np.sqrt(covariance[-1, -1])


def answering(answer, columns=COLUMNS):
    """Sharp columns that answer the mean move with a delay by a part of what `columns` promise."""
    move = mean_move(columns)
    return columns @ (np.eye(3) + (answer - 1) * np.outer(move, [0, 0, 1]) / move[-1])


def exact(sharp, columns):
    """The covariance of the fixed point in full, `A^-1 C A^-T` with `A = (J^T J)^-1 J^T dr/dx`."""
    back = np.linalg.inv(inverse(columns) @ columns.T @ sharp)
    return back @ inverse(columns) @ back.T


@pytest.mark.parametrize("answer", [0.3, 0.8])
def test_errors_along_the_mean_move_are_those_of_the_fixed_point(answer):
    sharp = answering(answer)
    lacking = run_alone(unanswered(ending(sharp)))
    np.testing.assert_allclose(inverse(COLUMNS) + np.outer(lacking, lacking), exact(sharp, COLUMNS), rtol=1e-6)


def test_the_error_of_the_delay_is_that_of_the_fixed_point_whatever_its_derivative_lacks():
    sharp = COLUMNS * [1.0, 1.0, 0.7]
    lacking = run_alone(unanswered(ending(sharp)))
    assert inverse(COLUMNS)[-1, -1] + lacking[-1] ** 2 == pytest.approx(exact(sharp, COLUMNS)[-1, -1], rel=1e-6)


def test_what_the_traces_hardly_tell_does_not_look_like_an_answer():
    """A logarithm with a large error that goes with the delay: a perfect model answers in full."""
    columns = COLUMNS * [0.02, 1.0, 1.0]
    calibrator = ending(columns, columns=columns)
    assert calibrator.uncertainty().std_errors[0] > VAGUE
    np.testing.assert_allclose(run_alone(unanswered(calibrator)), 0.0, atol=1e-4)  # the root of rounding
    lacking = run_alone(unanswered(dataclasses.replace(calibrator, sharp=columns * [1.0, 1.0, 0.5])))
    assert lacking[-1] > 0


def test_a_bound_shortens_a_move_and_is_no_answer():
    """A value that may take three quarters of its move to one side, and a fifth of it."""
    move = mean_move(COLUMNS)
    for part in (0.75, 0.2):
        upper = np.where(np.arange(3) == 1, part * abs(move[1]), np.inf)
        transform = Transform(FREE_TO_MOVE.positive, np.ones(3), -np.full(3, np.inf), upper)
        for answer, lacking in ((1.0, 0.0), (0.5, np.sqrt(3) * move)):
            found = run_alone(unanswered(ending(answering(answer), transform=transform)))
            np.testing.assert_allclose(found, lacking + np.zeros(3), atol=1e-6)


@pytest.mark.parametrize("beyond", ["fails_beyond", "breaks_beyond"])
def test_one_simulation_beside_the_end_is_enough(beyond):
    calibrator = ending(answering(0.5), **{beyond: 0.0})
    np.testing.assert_allclose(run_alone(unanswered(calibrator)), np.sqrt(3) * mean_move(COLUMNS), rtol=1e-6)


def test_an_answer_shortens_no_error_and_lengthens_none_without_end():
    np.testing.assert_array_equal(run_alone(unanswered(ending(answering(1.3)))), np.zeros(3))
    for answer in (0.01, -1.0):
        lacking = run_alone(unanswered(ending(answering(answer))))
        np.testing.assert_allclose(lacking, mean_move(COLUMNS) * np.sqrt(LEAST**-2 - 1), rtol=1e-6)


@pytest.mark.parametrize(
    ("progress", "unknown"),
    [
        (dataclasses.replace(END, late=False), Unknown()),
        (dataclasses.replace(END, around=()), Unknown()),
        (dataclasses.replace(END, lost=True), Unknown()),
        (dataclasses.replace(END, edges=((0.1,),)), Unknown()),
        (END, Unknown(numerics=False)),
    ],
    ids=["timely", "not settled", "lost", "edges", "no numerical errors"],
)
def test_where_no_delay_is_free_or_nothing_is_corrected_nothing_is_asked(progress, unknown):
    calibrator = ending(answering(0.5), progress, unknown=unknown, fails_beyond=-np.inf)
    np.testing.assert_array_equal(run_alone(unanswered(calibrator)), np.zeros(3))


FREE = ["diaphragm.stiffness", "diaphragm.preload", "chamber.volume"]


@pytest.fixture(scope="module")
def ended():
    """A fit at its end, of a duty that was 4 ms late for a plant without a smooth seat."""
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4)
    applied = trace.replace(pwm=np.concatenate([np.zeros(4), trace.pwm[:-4]]))
    run = vgtjax.simulate(with_sharp_seat(vgtjax.Actuator()), applied, stepping=FixedStep(max_step=1e-4))
    rng, count = np.random.default_rng(5), len(trace.time)
    seen = trace.replace(x_d=run.x_d + rng.normal(0, 8e-6, count), p_act=run.p_act + rng.normal(0, 60.0, count))
    return run_alone(start_calibration(plan_task(vgtjax.Actuator(), [seen], free=FREE, unknown=Unknown())).ending())


def test_a_calibration_has_it_in_its_errors_and_their_budget(ended, monkeypatch):
    bare = ended.uncertainty().std_errors
    lacking = bare * [0.5, -2.0, 1.0, 3.0]

    def known(calibrator):
        assert calibrator is ended
        return lacking
        yield

    before = ended.finish()
    monkeypatch.setattr(_calibrator, "unanswered", known)
    found = ended.finish()
    more = found.uncertainty.covariance - before.uncertainty.covariance
    np.testing.assert_allclose(more, np.outer(lacking[:-1], lacking[:-1]), rtol=1e-6)
    grown = np.sqrt(found.duty_delay_error**2 - before.duty_delay_error**2)
    assert grown == pytest.approx(found.transform.scale[-1] * 3 * bare[-1])
    np.testing.assert_allclose(found.budget.combined, found.std_errors, rtol=1e-6)
    # In a band, values and delay cancel as they do in what is seen; what corrections scattered is beside it.
    search, units = ended.minimiser, found.transform.slope(ended.minimiser.slopes.at)
    (alone,) = spread_of(search.problem.bundles, search.slopes.columns, np.outer(lacking * units, lacking * units))
    channels = [calibration.traces[0].channels for calibration in (before, found)]
    for place, channel in enumerate(("x_d", "p_act")):
        more = channels[1][channel].error ** 2 - channels[0][channel].error ** 2
        np.testing.assert_allclose(more, alone[:, place] ** 2, rtol=1e-4, atol=1e-6 * np.max(more))


def test_the_delay_has_the_tolerance_of_what_is_held_in_its_error(ended, monkeypatch):
    """As every other error: a spring that is stiffer by a tenth moves the duty as well."""
    before = ended.finish()
    held = dataclasses.replace(ended.task, deviations={"converter.return_spring_stiffness": 500.0})
    found = dataclasses.replace(ended, task=held).finish()
    (moved,) = run_alone(_finish._moved_by_tolerances(held, ended.minimiser)).values()
    part = float(moved[-1]) * found.transform.scale[-1]
    assert part != 0
    assert found.duty_delay_error == pytest.approx(np.hypot(before.duty_delay_error, part), rel=1e-9)
