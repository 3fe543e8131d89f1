"""What fitted delays say of how a duty was held."""

import numpy as np
import pytest

from vgtjax.identification import judge_hold

SLOW, FAST = 10e-3, 1e-3


def judged(delays, intervals, error=2e-5, stated="zero-order"):
    covariance = np.diag(np.broadcast_to(error, len(delays)) ** 2)
    return judge_hold(np.array(delays), covariance, np.array(intervals), stated)


def test_a_duty_that_would_arrive_early_was_linear():
    verdict = judged([-4.5e-3], [SLOW])
    assert (verdict.hold, verdict.decided) == ("linear", True)
    assert verdict.delay == pytest.approx(0.5e-3)
    assert verdict.reason == "a duty that is held would arrive before it is given"


def test_a_linear_duty_without_a_delay_has_none():
    assert judged([-5e-3 + 2e-5], [SLOW]).delay == 0.0


def test_what_the_study_states_does_not_matter():
    verdict = judged([0.5e-3], [SLOW], stated="linear")
    assert (verdict.hold, verdict.delay, verdict.decided) == ("linear", pytest.approx(0.5e-3), True)


def test_no_delay_is_held_where_it_is_known_well_enough():
    verdict = judged([1e-5], [SLOW])
    assert (verdict.hold, verdict.delay, verdict.decided) == ("zero-order", 0.0, True)
    verdict = judged([1e-4], [FAST], error=1e-4)
    assert (verdict.hold, verdict.delay, verdict.decided) == ("zero-order", 0.0, False)


@pytest.mark.parametrize("stated", ["zero-order", "linear"])
def test_one_interval_does_not_tell_the_hold_of_a_late_duty(stated):
    verdict = judged([6e-3], [SLOW], stated=stated)
    assert (verdict.hold, verdict.delay, verdict.decided) == (stated, pytest.approx(6e-3), False)


@pytest.mark.parametrize(
    ("delays", "hold", "delay"), [([4e-3, 4e-3], "zero-order", 4e-3), ([3e-3, 7.5e-3], "linear", 8e-3)]
)
def test_two_intervals_do(delays, hold, delay):
    verdict = judged(delays, [SLOW, FAST])
    assert (verdict.hold, verdict.decided) == (hold, True)
    assert verdict.delay == pytest.approx(delay)
    assert verdict.reason.endswith("would not be equally late in all traces")


@pytest.mark.parametrize("delays", [[3e-3, 20e-3], [-9e-3, -9e-3]])
def test_what_neither_explains_is_not_decided(delays):
    verdict = judged(delays, [SLOW, FAST])
    assert (verdict.hold, verdict.decided) == ("zero-order", False)
    assert verdict.reason == "neither a held duty nor a linear one explains the delays of all traces"


def test_traces_that_tell_nothing_decide_nothing():
    verdict = judge_hold(np.zeros(1), np.full((1, 1), np.nan), np.array([SLOW]), "linear")
    assert (verdict.hold, verdict.decided) == ("linear", False)
