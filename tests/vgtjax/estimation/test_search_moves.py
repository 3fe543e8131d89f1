"""How far a search moves at once, and what becomes of one that moves nowhere."""

import dataclasses

import numpy as np
import pytest
from known_truth import TRUTH, bench

import vgtjax
from vgtjax import estimation
from vgtjax.estimation import LevenbergMarquardt, Progress, plan_task, run_alone, start_calibration
from vgtjax.estimation.search._point import Reduced
from vgtjax.estimation.search._progress import LENGTHS
from vgtjax.estimation.search._search import MOST_MOVES


def far_task() -> estimation.Task:
    """The chamber's volume from nearly half of it, 0.58 away in its logarithm."""
    return plan_task(vgtjax.Actuator(), [bench(0)], free=["chamber.volume"], values={**TRUTH, "chamber.volume": 3.2e-5})


def far_search(**progress) -> LevenbergMarquardt:
    begun = start_calibration(far_task()).minimiser
    return run_alone(LevenbergMarquardt.begin(begun.problem, dataclasses.replace(begun.progress, **progress)))


def test_no_trial_goes_farther_than_it_may():
    search = far_search(longest=0.02)
    start = np.array(search.progress.coordinates)
    moved = np.array(search.step().coordinates) - start
    # Six moves at most, each as long as it may be: the way to go is longer.
    assert 0.02 < np.max(np.abs(moved)) <= MOST_MOVES * 0.02 + 1e-12  # rounding


def test_a_gain_by_rounding_alone_ends_a_search(monkeypatch):
    """Trials go nowhere, but the program without derivatives finds less misfit there than the one with them."""
    search = far_search()
    usual = estimation.search._search.misfit_at

    def less(problem, coordinates):
        return 0.999 * (yield from usual(problem, coordinates))

    monkeypatch.setattr(estimation.search._search, "misfit_at", less)
    monkeypatch.setattr(Reduced, "damped_steps", lambda self, sizes: np.zeros((len(sizes), 1)))
    progress = search.step()
    assert progress.stuck
    assert progress.finished


@pytest.mark.parametrize("good", LENGTHS[1:])
def test_a_search_that_got_stuck_begins_again_by_moves_of_other_lengths(monkeypatch, good):
    usual = LevenbergMarquardt._near

    def one_length_only(self, steps):
        return usual(self, steps) * (self.progress.longest == good)

    monkeypatch.setattr(LevenbergMarquardt, "_near", one_length_only)
    seen: list[Progress] = []
    found = start_calibration(far_task()).run(seen.append)
    assert found.converged
    assert found.values[0] == pytest.approx(57e-6, rel=0.02)  # as above
    assert seen[0].stuck
    assert found.progress.longest == good
