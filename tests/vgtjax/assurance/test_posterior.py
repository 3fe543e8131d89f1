"""Draws from the posterior of a fit: as wide as its errors where the model is as good as linear, and told where not."""

import dataclasses
import sys

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax import InputError
from vgtjax.assurance import CHAINS, WARM_UP, Drawn, Sampler
from vgtjax.estimation import End, Unknown, plan_task, start_calibration

DRAWS = 25
"""Of each chain, after the warm-up: 100 draws, nearly independent, tell a deviation to 7 %."""


@pytest.fixture(scope="module")
def calibrator():
    choices = Unknown(False, False, "white", "gaussian", numerics=False, start_state=False)
    calibrator = start_calibration(
        plan_task(vgtjax.Actuator(), [bench(0).window(0.0, 0.4)], free=FREE, unknown=choices)
    )
    calibrator.run()
    return calibrator


@pytest.fixture(scope="module")
def sampler(calibrator):
    return Sampler(End.of(calibrator))


@pytest.fixture(scope="module")
def drawn(sampler):
    drawn = sampler.first()
    for _ in range(WARM_UP + DRAWS):
        drawn = sampler.onward(drawn)
    return drawn


def test_draws_are_as_wide_as_the_errors_of_a_fit_that_is_as_good_as_linear(calibrator, sampler, drawn):
    fit, found = calibrator.finish(), sampler.posterior(drawn)
    assert found.entries == fit.task.selection.entries
    assert found.draws.shape == (CHAINS, DRAWS, len(FREE))
    deviations = found.draws.reshape(-1, len(FREE)).std(axis=0)
    np.testing.assert_allclose(deviations, fit.std_errors, rtol=0.3)  # four deviations of what 100 draws tell
    assert np.all(np.abs(found.medians - fit.values) < 0.5 * fit.std_errors)  # four deviations of a median of 100
    assert found.divergent == 0
    assert found.verdict.startswith("the chains have mixed")
    assert np.all((found.intervals[:, 0] < fit.values) & (fit.values < found.intervals[:, 1]))


def test_draws_that_are_gone_on_with_are_those_of_a_run_that_never_stopped(calibrator, drawn):
    """From what a file keeps, within the warm-up and after it."""
    for count in (3, WARM_UP + 1):
        kept = [each[:, :count] for each in dataclasses.astuple(drawn)]
        again = Sampler(End.of(calibrator)).onward(Drawn(*kept))
        np.testing.assert_array_equal(again.places, drawn.places[:, : count + 1])
        np.testing.assert_array_equal(again.acceptance, drawn.acceptance[:, : count + 1])


def test_chains_that_stay_apart_are_told(sampler, drawn):
    apart = drawn.places + 3.0 * np.arange(CHAINS)[:, None, None]
    found = sampler.posterior(dataclasses.replace(drawn, places=apart))
    assert "have not mixed" in found.verdict
    assert "take more draws" in found.verdict


def test_nothing_is_drawn_beyond_a_bound(calibrator):
    end = End.of(calibrator)
    bounded = dataclasses.replace(end.problem.transform, upper=np.array(end.at))
    problem = dataclasses.replace(end.problem, transform=bounded)
    sampler = Sampler(dataclasses.replace(end, problem=problem))
    drawn = sampler.first()
    for _ in range(5):
        drawn = sampler.onward(drawn)
    moved = end.directions.moves @ np.swapaxes(drawn.places, 1, 2)
    assert np.all(end.at[:, None] + moved <= end.at[:, None])


def test_without_the_package_it_says_what_to_install(calibrator, monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(InputError, match=r"run pip install '\.\[posterior\]' in a clone of vgtjax"):
        Sampler(End.of(calibrator))
