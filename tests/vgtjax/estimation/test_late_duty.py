"""A duty that reaches the valve later than its record says: what is simulated, and how that changes with the delay."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import FixedStep
from vgtjax.estimation import bundle_traces, observe
from vgtjax.estimation.derivatives._sensitivities import observe_backwards, observe_with_jacobian
from vgtjax.parameters import select
from vgtjax.parts import with_sharp_seat
from vgtjax.traces import Drive, Ramp, delay_duty

LEVELS = (0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3)


def late_by(delay, duty, duration, rate=None):
    """A duty in percent that is `delay` s late, at the start of every interval, with its rate and knot there."""
    zero = jnp.zeros_like(duty)
    drive = Drive(duration, zero, Ramp(zero, zero), pwm=duty, pwm_rate=zero if rate is None else rate)
    return delay_duty(drive, jnp.asarray(delay))


def area(drive):
    """The mean over every interval."""
    left = drive.duration * (1 - drive.knot.place)
    return (
        drive.pwm
        + 0.5 * drive.pwm_rate * drive.duration
        + (drive.knot.jump + 0.5 * drive.knot.bend * left) * (1 - drive.knot.place)
    )


def test_a_late_duty_jumps_inside_of_intervals():
    """By hand: two steps of a 1 ms record, 1.5 ms late, two whole ones late, and one early."""
    duty, duration = jnp.asarray([0.0, 0.0, 80.0, 80.0, 30.0, 30.0, 30.0]), jnp.full(7, 1e-3)
    late = late_by(1.5e-3, duty, duration)
    np.testing.assert_allclose(late.pwm, [0.0, 0.0, 0.0, 0.0, 80.0, 80.0, 30.0], atol=1e-9)
    np.testing.assert_allclose(late.knot.jump, [0.0, 0.0, 0.0, 80.0, 0.0, -50.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(late.knot.place[jnp.asarray([3, 5])], 0.5, atol=1e-9)
    np.testing.assert_array_equal([late.pwm_rate, late.knot.bend], np.zeros((2, 7)))
    for delay, by in ((2e-3, 2), (-1e-3, -1)):
        late = late_by(delay, duty, duration)
        settled = late.pwm + jnp.where(late.knot.place < 0.5, late.knot.jump, 0.0)
        np.testing.assert_allclose(settled[2:6], np.roll(duty, by)[2:6], atol=1e-9)


def test_a_duty_that_jumps_twice_in_an_interval_has_its_mean_there():
    """By hand, from 1.5 to 3.5 ms: a quarter of a millisecond of nothing, a half of 60 %, the rest of 20 %."""
    late = late_by(0.75e-3, jnp.asarray([0.0, 60.0, 20.0, 20.0]), jnp.asarray([1e-3, 0.5e-3, 2e-3, 1e-3]))
    np.testing.assert_allclose(late.pwm, [0.0, 0.0, (0.5 * 60 + 1.25 * 20) / 2, 20.0], atol=1e-9)
    np.testing.assert_allclose(late.knot.jump, 0.0)


@pytest.mark.parametrize("delay", [4e-3, 10e-3, -4e-3])
def test_a_late_duty_that_is_linear_between_samples_is_so_still(delay):
    """Within every interval, on a line at each side of its knot, against interpolation in a record that is moved."""
    duty, duration = np.array([0.0, 0.0, 80.0, 80.0, 30.0, 35.0, 35.0, 35.0]), np.append(np.full(7, 1e-2), 0.0)
    time = 1e-2 * np.arange(8)
    rate = np.append(np.diff(duty) / 1e-2, 0.0)
    late = late_by(delay, *map(jnp.asarray, (duty, duration, rate)))
    for part in (0.0, 0.3, 0.39, 0.41, 0.61, 0.7):
        after = jnp.where(part > late.knot.place, late.knot.jump + late.knot.bend * 1e-2 * (part - late.knot.place), 0)
        there = np.asarray(late.pwm + late.pwm_rate * 1e-2 * part + after)[:-1]
        np.testing.assert_allclose(there, np.interp(time[:-1] + 1e-2 * part - delay, time, duty), atol=1e-9)


@pytest.mark.parametrize("delay", [1e-3, 7e-3])
def test_a_straight_line_has_no_knots_however_late_it_is(delay):
    """Over some intervals of two samples, and late by whole samples, of which rounding may see two in one."""
    duration = np.append(np.where(np.arange(400) % 7 == 3, 2e-3, 1e-3), 0.0)
    time = np.append(0.0, np.cumsum(duration)[:-1])
    rate = np.append(np.full(400, 47.0), 0.0)
    late = late_by(delay, *map(jnp.asarray, (3.0 + 47.0 * time, duration, rate)))
    begun = slice(20, -1)
    np.testing.assert_allclose(late.pwm[begun], 3.0 + 47.0 * (time[begun] - delay), atol=1e-9)
    np.testing.assert_allclose(late.pwm_rate[begun], 47.0, atol=1e-6)
    np.testing.assert_array_equal(late.knot.jump[begun], 0.0)
    np.testing.assert_array_equal(late.knot.bend[begun], 0.0)


def test_a_bent_duty_keeps_its_mean_where_it_bends_twice():
    time = np.array([0.0, 1e-3, 2e-3, 4e-3, 5e-3])
    duty, duration = np.array([0.0, 0.0, 8.0, 8.0, 8.0]), np.append(np.diff(time), 0.0)
    late = late_by(1.5e-3, *map(jnp.asarray, (duty, duration, np.append(np.diff(duty) / np.diff(time), 0.0))))
    # From 2 to 4 ms it is what it was from 0.5 to 2.5 ms: zero, a rise of 8 % in a millisecond, and constant.
    assert late.pwm[2] + 0.5 * late.pwm_rate[2] * 2e-3 == pytest.approx((0.5 * 8 + 0.5 * 8) / 2)
    assert late.pwm_rate[2] == pytest.approx(8 / 2e-3)
    assert late.knot.bend[2] == 0.0


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("delay", [0.4e-3, 4.3e-3])
def test_a_late_duty_has_the_slope_of_its_differences(delay, linear):
    rng = np.random.default_rng(1)
    duty, duration = jnp.asarray(rng.uniform(0, 100, 50)), jnp.asarray(rng.uniform(0.5e-3, 2e-3, 50)).at[-1].set(0.0)
    rate = jnp.append(jnp.diff(duty) / duration[:-1], 0.0) if linear else None

    def mean(late):
        return area(late_by(late, duty, duration, rate))

    slope = jax.jacfwd(mean)(jnp.asarray(delay))
    above, below = (mean(jnp.asarray(delay + step)) for step in (1e-9, -1e-9))
    # Piecewise smooth: exact but for rounding of a percent in a nanosecond.
    np.testing.assert_allclose(slope, (above - below) / 2e-9, rtol=1e-5, atol=1e-2)


@pytest.fixture(scope="module")
def bundle():
    trace = duty_trace(*LEVELS, p_res=2.0e4, x_d=0.0, p_act=101013.0)
    return bundle_traces(vgtjax.Actuator(), [trace])[0]


def test_the_derivative_by_the_delay_is_that_of_the_simulation(bundle, actuator):
    """The last column of the segment-parallel Jacobian against differences, between kinks."""
    selection, delay, step = select(actuator, ["diaphragm.stiffness"]), 2.6e-3, 2e-6
    _, columns, _ = observe_with_jacobian(actuator, selection, bundle, jnp.asarray(delay))
    above, below = (np.asarray(observe(actuator, bundle, jnp.asarray(delay + by))[0]) for by in (step, -step))
    difference = (above - below) / (2 * step)
    assert columns.shape == (*difference.shape, 2)
    for channel in range(2):
        exact, approximate = np.asarray(columns[..., channel, 1]), difference[..., channel]
        assert np.linalg.norm(exact - approximate) < 1e-6 * np.linalg.norm(exact)  # measured: 1e-8


def test_the_derivative_by_the_delay_hardly_changes_with_it(bundle, actuator):
    """Over a millisecond, of which every half is a step: by a few percent. Of a mean duty over steps it doubled and
    halved, as force goes with the square of the duty."""
    selection, delays = select(actuator, ["diaphragm.stiffness"]), (2.1e-3, 2.45e-3, 2.55e-3, 2.9e-3)
    slopes = [
        np.asarray(observe_with_jacobian(actuator, selection, bundle, jnp.asarray(delay))[1])[..., 1]
        for delay in delays
    ]
    for slope in slopes[1:]:
        for channel in range(2):
            difference = np.linalg.norm((slope - slopes[0])[..., channel])
            assert difference < 0.1 * np.linalg.norm(slopes[0][..., channel])  # measured: 0.03 to 0.06


@pytest.mark.parametrize("delay", [None, 2.5e-3])
def test_reverse_mode_finds_what_forward_mode_does(bundle, actuator, delay):
    selection = select(actuator, ["diaphragm.stiffness", "diaphragm.preload", "chamber.volume"])
    delay = None if delay is None else jnp.asarray(delay)
    observed, columns, _ = observe_with_jacobian(actuator, selection, bundle, delay)
    cotangent = np.random.default_rng(2).normal(size=observed.shape) * [1e5, 1e-2]
    expected = np.einsum("lsc,lscp->p", cotangent, np.asarray(columns))
    found = observe_backwards(actuator, selection, bundle, delay, jnp.asarray(cotangent))
    np.testing.assert_allclose(found, expected, rtol=1e-9)  # rounding


STEPS = FixedStep(max_step=1e-4)


def stairs():
    """A duty that falls by 6.7 % a second in stairs of 10 ms, recorded at 100 Hz: the plunger grazes its seat."""
    duty = np.concatenate([np.zeros(5), np.full(50, 80.0), 80.0 - 0.067 * np.arange(250)])
    time = 1e-2 * np.arange(len(duty))
    return vgtjax.Trace(time, pwm=duty, p_res=np.full(len(duty), 2.0e4))


@pytest.fixture(scope="module")
def late_stairs():
    """Chamber pressure in Pa at the samples of these, 3 ms late, by a duty that is given every millisecond."""
    slow = stairs()
    time = 1e-3 * np.arange(10 * len(slow.time) - 9)
    pwm = np.asarray(slow.at("pwm", np.maximum(time - 3e-3, 0.0) + 1e-9))
    fine = vgtjax.Trace(time, pwm=pwm, p_res=np.full(len(time), 2.0e4))
    return np.asarray(vgtjax.simulate(with_sharp_seat(vgtjax.Actuator()), fine, stepping=STEPS).p_act)[::10]


def missed(pressure, late_stairs):
    """Mean of what is missed of the chamber pressure where the duty falls, in Pa."""
    return float(np.mean((pressure - late_stairs)[80:]))


def test_late_stairs_of_a_slow_record_are_late_and_not_blurred(late_stairs):
    plant, slow = with_sharp_seat(vgtjax.Actuator()), stairs()
    (bundle,) = bundle_traces(plant, [slow], STEPS)
    (free,) = bundle.from_lanes(np.asarray(observe(plant, bundle, jnp.asarray(3e-3))[0]))
    assert abs(missed(free[:, 1], late_stairs)) < 1.0  # what chatter leaves; measured: 0.07
    known = slow.with_late_duty(3e-3)
    given = np.asarray(vgtjax.simulate(plant, known, stepping=STEPS).p_act)[known.rows_at(slow.time)]
    assert abs(missed(given, late_stairs)) < 1.0  # measured: 0.08


def test_a_mean_over_intervals_would_blur_them(late_stairs):
    plant, slow = with_sharp_seat(vgtjax.Actuator()), stairs()
    blurred = slow.replace(pwm=0.7 * slow.pwm + 0.3 * np.append(0.0, slow.pwm[:-1]))
    pressure = np.asarray(vgtjax.simulate(plant, blurred, stepping=STEPS).p_act)
    assert abs(missed(pressure, late_stairs)) > 5.0  # measured: 11.8


def test_a_duty_that_is_linear_between_slow_samples_is_no_staircase():
    """A duty that falls as slowly, given every millisecond and 3 ms late, against what is read of every tenth value."""
    plant, slow = with_sharp_seat(vgtjax.Actuator()), stairs().with_ramped_duty()
    time = 1e-3 * np.arange(10 * len(slow.time) - 9)
    applied = np.interp(time - 3e-3, slow.time, slow.pwm)
    fine = vgtjax.Trace(time, pwm=applied, p_res=np.full(len(time), 2.0e4), duty_hold="linear")
    expected = np.asarray(vgtjax.simulate(plant, fine, stepping=STEPS).p_act)[::10]
    (bundle,) = bundle_traces(plant, [slow], STEPS)
    (free,) = bundle.from_lanes(np.asarray(observe(plant, bundle, jnp.asarray(3e-3))[0]))
    known = slow.with_late_duty(3e-3)
    given = np.asarray(vgtjax.simulate(plant, known, stepping=STEPS).p_act)[known.rows_at(slow.time)]
    means = slow.with_held_duty().with_late_duty(3e-3)
    staircase = np.asarray(vgtjax.simulate(plant, means, stepping=STEPS).p_act)[means.rows_at(slow.time)]
    assert abs(missed(free[:, 1], expected)) < 1.0  # measured: 0.08
    assert abs(missed(given, expected)) < 1.0  # measured: 0.05
    assert abs(missed(staircase, expected)) > 5.0  # measured: 7.7
