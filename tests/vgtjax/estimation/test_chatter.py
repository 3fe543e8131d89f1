"""What a sharp simulation chatters has the phase of the record in what a fit is corrected for."""

import numpy as np
import pytest

from vgtjax.estimation.measurements._chatter import STRETCH, in_phase

DEVIATION, SWING = 60.0, 20.0
COUNT = 6 * STRETCH
ALTERNATING = SWING * (-1.0) ** np.arange(COUNT)
SLOW = 30 * np.sin(np.arange(COUNT) / 40)
NOISE = np.random.default_rng(0).normal(0, DEVIATION, COUNT)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_swing_gets_the_phase_of_the_record(sign):
    corrected = in_phase(SLOW + ALTERNATING, SLOW + sign * ALTERNATING + 500.0, deviation=1e-3)
    # What moves slowly beside it looks like some thousandths of the swing; the ends have fewer neighbours.
    assert corrected[4:-4] == pytest.approx((SLOW + sign * ALTERNATING)[4:-4], abs=5e-3 * SWING)


def test_in_noise_a_wrong_phase_leaves_hardly_more_than_the_right_one():
    left = [
        NOISE + SLOW - ALTERNATING - in_phase(SLOW + sign * ALTERNATING, NOISE + SLOW - ALTERNATING, DEVIATION)
        for sign in (-1, 1)
    ]
    right, wrong = (float(np.sum((each / DEVIATION) ** 2)) for each in left)
    as_it_is = float(np.sum(((NOISE - 2 * ALTERNATING) / DEVIATION) ** 2))
    noise = float(np.sum((NOISE / DEVIATION) ** 2))
    assert as_it_is > noise + 100  # 4 x (20 / 60)^2 x 300, and what the noise has of the swing by chance
    assert right == pytest.approx(wrong, abs=2.0)  # the ends have fewer neighbours
    assert abs(wrong - noise) < COUNT / STRETCH + 3  # each stretch has one factor, of which noise may take one chi^2


def test_an_outlier_does_not_tell_the_phase_of_its_stretch():
    left = SLOW + ALTERNATING + NOISE / 10
    left[120] -= np.sign(ALTERNATING[120]) * 30 * DEVIATION
    found = in_phase(SLOW + ALTERNATING, left, DEVIATION / 10)
    assert found[104:146] == pytest.approx((SLOW + ALTERNATING)[104:146], abs=0.3 * SWING)


def test_a_swing_that_the_record_does_not_show_is_taken_away():
    corrected = in_phase(SLOW + ALTERNATING, SLOW, deviation=1e-3)
    assert corrected[4:-4] == pytest.approx(SLOW[4:-4], abs=5e-3 * SWING)


def test_a_swing_has_at_most_its_own_size():
    corrected = in_phase(ALTERNATING, 5 * ALTERNATING, deviation=1e-3)
    assert corrected[4:-4] == pytest.approx(ALTERNATING[4:-4], rel=1e-6)


def test_what_does_not_chatter_stays():
    transient = np.where(np.arange(COUNT) < 100, 0.0, 40 * np.exp(-(np.arange(COUNT) - 100) / 3))
    damped = transient * np.cos(np.arange(COUNT) - 100)  # turns back every third sample, fewer than half of all
    for defect in (SLOW, transient, damped, np.zeros(COUNT)):
        assert np.array_equal(in_phase(defect, NOISE, DEVIATION), defect)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_samples_have_no_phase(count):
    assert in_phase(np.arange(count, dtype=float), np.zeros(count), DEVIATION) == pytest.approx(np.arange(count))
