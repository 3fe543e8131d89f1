"""Errors by sums over windows of time against the spread that estimates really have, with noise that has a memory."""

import dataclasses
import types

import numpy as np
import pytest
import scipy.signal
from known_truth import FREE, bench

import vgtjax
from vgtjax.estimation import least_squares, plan_task, start_calibration
from vgtjax.estimation._finish import _by_windows
from vgtjax.estimation._least_squares import windowed_gram

COUNT, TRACES, WINDOW = 1500, 3, 60
OWNER = np.repeat(np.arange(TRACES), COUNT)
TIME = np.tile(np.linspace(0, 1, COUNT), TRACES)
COLUMNS = np.column_stack([np.sin(9 * TIME + OWNER), np.cos(31 * TIME), np.sign(np.sin(5 * TIME)) * TIME])


def records(memory, draws):
    white = np.random.default_rng(3).normal(size=(draws, TRACES, 200 + COUNT))
    return scipy.signal.lfilter([1.0], [1.0, -memory], white)[:, :, 200:].reshape(draws, -1)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_errors_by_windows_are_the_spread_of_the_estimates(memory):
    estimates, by_windows, claimed = [], [], []
    for noise in records(memory, 400):
        found = least_squares(COLUMNS, noise)
        residuals = noise - COLUMNS @ found.values
        gram = windowed_gram(COLUMNS * residuals[:, None], OWNER, np.full(TRACES, WINDOW))
        by_windows.append(np.diag(found.covariance @ gram @ found.covariance))
        claimed.append(np.diag(found.covariance) * np.mean(residuals**2))
        estimates.append(found.values)
    spread = np.std(estimates, axis=0)
    # A tenth: three deviations of a spread of 400, and what a window of sixty samples cuts off of a memory of five.
    np.testing.assert_allclose(np.sqrt(np.mean(by_windows, axis=0)), spread, rtol=0.12)
    usual = np.sqrt(np.mean(claimed, axis=0)) / spread
    if memory:
        assert np.all(usual < 0.5)  # a noise that is taken for white claims a third
    else:
        np.testing.assert_allclose(usual, 1.0, rtol=0.12)


def test_windows_of_one_are_the_usual_sandwich():
    scores = np.random.default_rng(4).normal(size=(300, 2))
    found = windowed_gram(scores, np.zeros(300, int), np.array([1]))
    np.testing.assert_allclose(found, scores.T @ scores * 300 / 298, rtol=1e-12)


def test_windows_are_as_long_in_traces_of_every_rate():
    """Beside slow traces a window had as many samples of a fast one, and was too short for the noise there."""
    rng, seconds = np.random.default_rng(6), (12, 12, 12)
    slow, fast = rng.normal(size=(3 * 12 * 25, 1)), rng.normal(size=(12 * 100, 1))
    fast = scipy.signal.lfilter([1.0], [1.0, -0.9], fast, axis=0)
    alone = windowed_gram(fast, np.zeros(len(fast), int), np.array([20]))
    owner = np.repeat([0, 1, 2, 3], [*(25 * each for each in seconds), len(fast)])
    beside = windowed_gram(np.concatenate([1e-6 * slow, fast]), owner, np.array([5, 5, 5, 20]))
    # Of sixty windows and of four times as many: what one unknown has taken away.
    np.testing.assert_allclose(beside * (1 - 1 / 240), alone * (1 - 1 / 60), rtol=1e-9)


def test_a_fit_takes_as_long_windows_of_traces_of_every_rate():
    """Beside traces of which nothing is left and which tell nothing, as slow as they may be."""
    seen = start_calibration(plan_task(vgtjax.Actuator(), [bench(1)], free=FREE))
    trace, found, point = seen.task.fit[0], seen.uncertainty(), seen.minimiser.point

    def beside(clock):
        silent = np.zeros((3 * 2 * len(clock), point.columns.shape[1]))
        more = dataclasses.replace(
            point, residuals=np.append(point.residuals, silent[:, 0]), columns=np.vstack([point.columns, silent])
        )
        owner = np.append(seen.minimiser.problem.owner, np.repeat([1, 2, 3], 2 * len(clock)))
        traces = [trace, *3 * [types.SimpleNamespace(time=clock)]]
        search = types.SimpleNamespace(problem=types.SimpleNamespace(owner=owner), point=more)
        return _by_windows.__wrapped__(types.SimpleNamespace(fit=traces), search, found)

    as_fast, slow = beside(trace.time), beside(trace.time[::10])
    assert slow[0] == pytest.approx(as_fast[0], rel=0.1)  # a window has whole samples
    np.testing.assert_allclose(slow[1], as_fast[1], rtol=0.02)


def test_a_derivative_that_explodes_leaves_the_errors_of_others():
    """Its scores are numbers whose squares are none: all errors by windows were lost with it, and NumPy warned."""
    calibrator = start_calibration(plan_task(vgtjax.Actuator(), [bench(1)], free=FREE))
    task, search = calibrator.task, calibrator.minimiser
    columns = search.point.columns.copy()
    columns[:, -1] = 0.0  # as if the last one were not free
    search.point = dataclasses.replace(search.point, columns=columns)
    _, without = _by_windows(task, search, search.uncertainty())
    columns[:, -1] = 1e151 * np.random.default_rng(5).normal(size=len(columns))
    _, errors = _by_windows(task, search, search.uncertainty())
    assert np.all(without[:-1] > 0)
    # Chance makes a random column of many samples a little like the others.
    np.testing.assert_allclose(errors[:-1], without[:-1], rtol=0.1)
