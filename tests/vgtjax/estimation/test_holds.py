"""What fitted delays say of how a duty was held, by numbers."""

import numpy as np
import pytest

from vgtjax import Channel, Trace
from vgtjax.estimation.measurements._holds import judge_holds, sample_interval

SLOW, FAST = 10e-3, 1e-3


def judged(delays, intervals, error=2e-5):
    return judge_holds(np.array(delays), np.diag(np.full(len(delays), error**2)), np.array(intervals))


def test_a_duty_that_would_arrive_early_was_linear():
    holds = judged([-4.5e-3], [SLOW])
    assert (holds.linear, holds.decided) == ((SLOW,), True)
    assert holds.delay == pytest.approx(0.5e-3)


def test_no_delay_is_held_where_it_is_known_well_enough():
    assert (judged([1e-5], [SLOW]).linear, judged([1e-5], [SLOW]).decided) == ((), True)
    assert (judged([1e-4], [FAST], 1e-4).linear, judged([1e-4], [FAST], 1e-4).decided) == ((), False)


def test_one_interval_does_not_tell_the_hold_of_a_late_duty():
    holds = judged([6e-3], [SLOW])
    assert (holds.linear, holds.decided) == ((), False)
    assert holds.delay == pytest.approx(6e-3)


@pytest.mark.parametrize(
    ("delays", "linear", "delay"),
    [([4e-3, 4e-3], (), 4e-3), ([3e-3, 7.5e-3], (SLOW, FAST), 8e-3), ([-5e-3, 0.0], (SLOW,), 0.0)],
)
def test_two_intervals_do(delays, linear, delay):
    holds = judged(delays, [SLOW, FAST])
    assert (holds.linear, holds.decided) == (linear, True)
    assert holds.delay == pytest.approx(delay, abs=1e-5)


def test_a_hold_is_decided_where_only_that_of_faster_traces_is_open():
    """Half a sample of random levels at 500 Hz is a millisecond, and of a slow loop five."""
    found = judge_holds(np.array([-2e-4, -1.5e-4]), np.diag([2.7e-4, 1.1e-4]) ** 2, np.array([SLOW, 2e-3]))
    assert (found.linear, found.decided) == ((), True)
    closer = judge_holds(np.array([-2e-4, -1.5e-4]), np.diag([2e-3, 1.1e-4]) ** 2, np.array([SLOW, 2e-3]))
    assert not closer.decided  # the slow loop itself may have come half a sample later


@pytest.mark.parametrize("delays", [[3e-3, 20e-3], [-9e-3, -9e-3]])
def test_what_nothing_explains_is_not_decided(delays):
    assert not judged(delays, [SLOW, FAST]).decided


def test_the_interval_is_that_of_the_duty_whatever_the_other_clocks():
    duty, position = np.arange(0, 1, SLOW), np.arange(0, 1, FAST)
    trace = Trace(pwm=Channel(duty, 0 * duty), x_d=Channel(position, 0 * position))
    assert sample_interval(trace) == pytest.approx(SLOW)
    assert sample_interval(Trace(position, x_d=0 * position)) == pytest.approx(FAST)


@pytest.mark.parametrize(
    ("rate", "interval"),
    [(60, 0.0167), (80, 0.0125), (100, 1e-2), (333, 3e-3), (3e3, 3.3e-4), (2e4, 5e-5), (5e4, 2e-5)],
)
def test_an_interval_is_the_same_for_clocks_that_differ_a_little_at_any_rate(rate, interval):
    for factor in (0.999, 1.0, 1.001):
        time = 1000.0 + np.arange(50) * factor / rate
        assert sample_interval(Trace(time=time, pwm=np.zeros(50))) == interval
