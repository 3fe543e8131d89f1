"""Hysteresis loops read from runs whose width is known."""

import numpy as np
import pytest

from vgtjax.loops import find_loop


def run(width=2000.0, seconds=10.0, peak=10e-3, noise=0.0, samples=1000):
    """A rod pulled out and back between two straight branches, `width` Pa apart."""
    time = np.linspace(0, seconds, samples)
    x_d = peak * np.minimum(1, 1.2 * (1 - np.abs(2 * time / seconds - 1)))
    closing = time < seconds / 2
    p_act = 8.5e4 - 4e6 * x_d + np.where(closing, -0.5, 0.5) * width
    rng = np.random.default_rng(3)
    return time, x_d + noise * 8e-6 * rng.normal(size=samples), p_act + noise * 60 * rng.normal(size=samples)


def test_width_of_straight_branches_is_exact():
    loop = find_loop(*run())
    np.testing.assert_allclose(loop.width, 2000.0, rtol=1e-9)
    np.testing.assert_allclose(loop.closing, 8.5e4 - 4e6 * loop.position - 1000.0, rtol=1e-9)


def test_noise_averages_out():
    # Eight micrometres are 32 Pa here; about 15 samples a knot on each branch, 25 positions in the mean.
    assert find_loop(*run(noise=1.0)).mean_width == pytest.approx(2000.0, abs=15.0)


@pytest.mark.parametrize("case", [{"peak": 5e-3}, {"seconds": 0.5}])
def test_what_is_no_slow_loop_is_none(case):
    assert find_loop(*run(**case)) is None


def test_a_run_that_visits_the_span_twice_is_none():
    _, x_d, p_act = run()
    twice = np.concatenate([x_d, x_d])
    assert find_loop(np.linspace(0, 20, 2000), twice, np.concatenate([p_act, p_act])) is None
