"""Slices and profiles of problems whose misfit is known: linear, flat, kinked, skewed, bounded; and of a small fit."""

import dataclasses

import numpy as np
import pytest
from known_problem import Known, driven
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.estimation import (
    NORMAL_95,
    End,
    Point,
    Slice,
    Slices,
    look_around,
    plan_task,
    profiling,
    run_alone,
    slicing,
    start_calibration,
)
from vgtjax.estimation.diagnostics._around import _doubtful
from vgtjax.parameters import Transform

ROWS, NAMES = 60, ("a", "b", "c")
RNG = np.random.default_rng(5)
COLUMNS = np.linalg.qr(RNG.normal(size=(ROWS, 5)))[0]
"""Orthonormal: three directions of the unknowns, one for what remains."""
MIXED = COLUMNS[:, :3] @ np.array([[30.0, 5.0, 0.0], [0.0, 8.0, 0.3], [0.0, 0.0, 0.5]])


def free(lower=-np.inf, upper=np.inf):
    """Coordinates that are values, between bounds."""
    lower, upper = (np.broadcast_to(end, 3).astype(float) for end in (lower, upper))
    return Transform(np.zeros(3, bool), np.ones(3), lower, upper)


REMAINS = np.sqrt(ROWS - 3) * COLUMNS[:, 4]


def ended(residuals=lambda x: MIXED @ x + REMAINS, columns=MIXED, transform=None):
    point = Point(REMAINS, columns)
    found = point.uncertainty(ROWS)
    return End(Known(lambda seen: residuals(seen[0]), transform or free()), np.zeros(3), point, found, NAMES)


def along(end, direction, shape):
    """The problem with the misfit along one direction replaced: `shape` of standard errors is a distance."""
    unit = end.point.columns @ end.directions.moves[:, direction]

    def residuals(x):
        moved = end.point.columns @ x
        t = unit @ moved / (unit @ unit)
        return REMAINS + moved + unit * (shape(t) - t)

    return dataclasses.replace(end, problem=Known(lambda seen: residuals(seen[0]), free()))


def test_directions_are_those_of_the_correlation():
    end = ended()
    directions = end.directions
    errors = end.found.std_errors
    covariance = directions.moves @ directions.moves.T
    np.testing.assert_allclose(covariance, end.found.covariance, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.sum(directions.loadings**2, axis=1), 1.0, rtol=1e-9)
    np.testing.assert_allclose(directions.moves, errors[:, None] * directions.loadings, rtol=1e-9)
    sizes = np.sum(directions.loadings**2, axis=0)
    assert np.all(np.diff(sizes) <= 0)  # the least determined first


def test_a_linear_problem_has_parabolas():
    found = driven(slicing(ended()))
    assert [each.verdict for each in found.slices] == ["parabola"] * 3
    for each in found.slices:
        np.testing.assert_allclose(each.values, np.square(each.reaches), rtol=1e-7)
    assert found.flagged() == []


def test_what_is_not_determined_follows():
    """Two columns that are one: the third's error is what it is whatever these do, and no slice is without it."""
    columns = np.column_stack([MIXED[:, 0], MIXED[:, 0], MIXED[:, 1]])
    end = ended(lambda x: columns @ x + REMAINS, columns)
    assert end.found.estimable.tolist() == [False, False, True]
    (only,) = driven(slicing(end)).slices
    assert only.verdict == "parabola"
    assert only.carried_by == ["c"]


@pytest.mark.parametrize(
    ("shape", "verdict"),
    [
        (lambda t: 0.3 * t, "flat"),
        (lambda t: np.sign(t) * np.sqrt(t**2 + 4 * abs(t)), "kinked"),
        (lambda t: t if t > 0 else 0.3 * t, "skewed"),
        (lambda t: 1.5 * t, "narrow"),
        (lambda t: 0.7 * t, "wide"),
        (lambda t: np.nan if t > 1.5 else t, "fails"),
        (lambda t: 1.1 * t, "parabola"),
    ],
)
@pytest.mark.parametrize("direction", [0, 1, 2])
def test_what_is_no_parabola_is_called_by_its_name(shape, verdict, direction):
    end = along(ended(), direction, shape)
    found = driven(slicing(end), end.problem)
    expected = ["parabola"] * 3
    expected[direction] = verdict
    assert [each.verdict for each in found.slices] == expected
    if verdict != "parabola":
        assert found.flagged() == found.slices[direction].carried_by
        assert found.slices[direction].reaches == (-2.0, -1.0, 1.0, 2.0)


def test_a_direction_that_carries_little_is_looked_at_on_one_side():
    columns = COLUMNS[:, :3] @ np.array([[1.0, 1.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 1.0]])
    found = driven(slicing(ended(lambda x: columns @ x + REMAINS, columns)))
    assert [len(each.reaches) for each in found.slices] == [2, 2, 1]
    assert found.evaluations == 5
    assert found.slices[-1].verdict == "parabola"


def test_a_misfit_that_falls_is_seen():
    def residuals(x):
        return MIXED @ x + REMAINS * (1 - 0.1 * np.tanh(abs(x @ x) * 1e6))

    found = driven(slicing(ended(residuals)))
    assert {each.verdict for each in found.slices} == {"downhill"}


def test_a_minimum_elsewhere_is_seen():
    """The end is not where the linear problem has its minimum: the slope there says so, and how far it is."""
    end = ended()
    residuals = REMAINS + 0.8 * MIXED @ end.directions.moves[:, 0]
    point = Point(residuals, MIXED)
    found = dataclasses.replace(end, point=point, problem=Known(lambda seen: residuals + MIXED @ seen[0], free()))
    slices = driven(slicing(found)).slices
    assert [each.verdict for each in slices] == ["shifted", "parabola", "parabola"]
    assert slices[0].shift == pytest.approx(-0.8)


def test_bounds_shorten_a_slice_and_don_t_bend_it():
    end = ended(transform=free(lower=0.0))
    found = driven(slicing(end))
    assert {each.verdict for each in found.slices} <= {"parabola", "at bounds"}


def test_the_profile_of_a_linear_problem_is_the_linear_interval():
    found = driven(profiling(ended(), NAMES))
    assert list(found.profiles) == list(NAMES)
    for profile in found.profiles.values():
        # The others' chord is exact there, and so is the root between points.
        np.testing.assert_allclose(profile.ends, (-NORMAL_95, NORMAL_95), rtol=1e-6)
        assert profile.verdict == "bounded on both sides"
        linear = NORMAL_95 * profile.error
        np.testing.assert_allclose(profile.widened(linear), (-linear, linear), rtol=1e-6)


def test_others_follow_where_the_problem_is_curved():
    """A valley that bends: with the others straight, the misfit at its end would be many times as high."""
    bend = 400.0

    def residuals(x):
        return MIXED @ (x + np.array([bend * x[2] ** 2 / 900, 0, 0])) + REMAINS

    end = ended(residuals)
    found = driven(profiling(end, ["c"])).profiles["c"]
    straight = end.found.covariance[:, 2] / end.found.std_errors[2] * 2
    alone = end.rise(residuals(straight))
    assert alone > 10 * 4.0
    np.testing.assert_allclose(found.ends, (-NORMAL_95, NORMAL_95), rtol=0.02)


@pytest.mark.parametrize(
    ("shape", "verdict", "open_ends"),
    [
        (lambda t: t if t < 0 else 0.1 * t, "bounded only from below", (False, True)),
        (lambda t: t if t > 0 else 0.1 * t, "bounded only from above", (True, False)),
        (lambda t: 0.1 * t, "flat: not determined", (True, True)),
        (lambda t: t if t > 0 else 0.5 * t, "bounded on both sides, not symmetric", (False, False)),
    ],
)
def test_a_profile_says_what_is_known(shape, verdict, open_ends):
    columns = COLUMNS[:, :3]

    def residuals(x):
        error = np.sqrt(ended(columns=columns).found.scale)
        return REMAINS + columns @ np.array([error * shape(x[0] / error), x[1], x[2]])

    found = driven(profiling(ended(residuals, columns), ["a"])).profiles["a"]
    assert found.verdict == verdict
    assert tuple(np.isinf(found.ends)) == open_ends
    linear = NORMAL_95 * found.error
    low, high = found.widened(linear)
    assert low <= -linear * (1 - 1e-9)
    assert high >= linear * (1 - 1e-9)
    assert (np.isinf(low), np.isinf(high)) == open_ends


def test_a_bound_ends_a_profile():
    end = ended(transform=free(lower=np.array([-0.01, -np.inf, -np.inf])))
    found = driven(profiling(end, ["a"])).profiles["a"]
    assert found.limits[0] * found.error == pytest.approx(-0.01)
    assert found.ends[1] == pytest.approx(NORMAL_95, rel=1e-6)
    # And the interval with it, where the linear one goes beyond.
    beyond = 0.03
    assert found.widened(beyond) == (pytest.approx(-0.01), max(beyond, found.ends[1] * found.error))


def test_profiles_are_as_many_as_are_wanted():
    found = driven(profiling(ended(), NAMES, most=2))
    assert (list(found.profiles), found.left_out) == (["a", "b"], ["c"])


def test_what_is_hardly_determined_has_a_profile_before_what_slices_flag():
    """Standard errors of 1, 0.5 and 0.1 of logarithms: factors of 7, 2.7 and 1.2 to either side."""
    columns = COLUMNS[:, :3] / np.array([1.0, 0.5, 0.1])
    point = Point(REMAINS, columns)
    logarithms = dataclasses.replace(free(), positive=np.ones(3, bool))
    problem = Known(lambda seen: columns @ seen[0] + REMAINS, logarithms)
    end = End(problem, np.zeros(3), point, point.uncertainty(ROWS), NAMES)
    bent = Slice(0, {"a": 0.1, "b": 0.2, "c": 0.9}, (-2.0, 2.0), (8.0, 8.0), (2.0, 2.0))
    assert _doubtful(end, Slices([bent], 0, 2)) == ["a", "c"]
    assert _doubtful(dataclasses.replace(end, problem=ended().problem), Slices([bent], 0, 2)) == ["c"]  # no logarithms


@pytest.fixture(scope="module")
def calibrator():
    """A fit of three parameters to a trace with noise, at its end."""
    truth = {"diaphragm.stiffness": 12600.0, "diaphragm.preload": 51.0, "chamber.volume": 57e-6}
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4)
    run = simulate(vgtjax.replace_parameters(vgtjax.Actuator(), truth), trace)
    rng = np.random.default_rng(0)
    noisy = {
        name: np.asarray(getattr(run, name)) + rng.normal(0, size, len(trace.time)) for name, size in NOISE.items()
    }
    trace = vgtjax.Trace(time=trace.time, pwm=trace.pwm, p_res=trace.p_res, **noisy)
    calibrator = start_calibration(plan_task(vgtjax.Actuator(), [trace], free=list(truth)))
    return run_alone(calibrator.ending())


NOISE = {"x_d": 8e-6, "p_act": 60.0}


def test_a_real_fit_has_parabolas_and_its_linear_intervals(calibrator):
    end = End.of(calibrator)
    found = run_alone(slicing(end))
    assert len(found.slices) == 3
    assert found.evaluations <= 6
    assert found.no_parabolas == []
    profiles = run_alone(profiling(end, ["chamber.volume"]))
    # The model is smooth on the scale of these errors, a part in a thousand of the values.
    np.testing.assert_allclose(profiles.profiles["chamber.volume"].ends, (-NORMAL_95, NORMAL_95), rtol=0.1)


def test_intervals_have_the_profiles_of_what_was_looked_at(calibrator):
    calibration, around = run_alone(calibrator.finishing()), look_around(calibrator, "all")
    assert around.sentences == [f"profile of {name}: {each.verdict}" for name, each in around.profiles.profiles.items()]
    intervals = around.intervals(calibration)
    estimates = around.estimates(calibration)
    assert list(intervals) == list(estimates) == list(calibration)
    for name, found in calibration.estimates.items():
        (low, high), (lowest, highest) = found.interval, intervals[name]
        assert estimates[name] == dataclasses.replace(found, interval=(lowest, highest))
        # A profile widens an interval and never shortens it: to 1e-9 of its value for rounding, and hardly in so linear
        # a fit.
        assert lowest <= low * (1 + 1e-9)
        assert highest >= high * (1 - 1e-9)
        assert highest - lowest < 1.2 * (high - low)
    nothing = look_around(calibrator, "none")
    assert nothing.intervals(calibration) == {}
    assert nothing.estimates(calibration) == calibration.estimates
