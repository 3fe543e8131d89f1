"""How well the errors of the parameters leave simulated traces known."""

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax.estimation import calibrate, plan_task


@pytest.fixture(scope="module")
def run():
    """A fit with a trace that it does not see."""
    return calibrate(plan_task(vgtjax.Actuator(), [bench(0)], [bench(1)], free=FREE))


def test_of_many_draws_the_spread_is_the_error(run):
    """Linear propagation against simulations of what the covariance allows, fitted traces and others."""
    rng, selection = np.random.default_rng(3), run.task.selection
    draws = rng.multivariate_normal(run.values, run.covariance, 60)
    for result in run.traces:
        trace = result.trace
        seen = [vgtjax.simulate(selection.unpack(run.model, draw), trace) for draw in draws]
        for name, channel in result.channels.items():
            spread = np.std([np.asarray(each.signals[name]) for each in seen], axis=0)[trace.rows(name)]
            told = channel.error
            assert told.shape == channel.simulated.shape
            # Sixty draws tell a standard deviation to 9 %; a root mean square over a trace is a few of them.
            assert np.sqrt(np.mean(told**2)) == pytest.approx(np.sqrt(np.mean(spread**2)), rel=0.3), (trace.name, name)


def test_what_is_known_well_is_predicted_well(run):
    """Fifty thousand samples and three parameters: a hundredth of the noise, not zero."""
    for result in run.traces:
        for channel in result.channels.values():
            largest = float(np.max(channel.error))
            assert 0 < largest < channel.noise


def test_a_comparison_without_a_fit_has_none(run):
    (result,) = vgtjax.estimation.compare(plan_task(run.model, [bench(0)], free=[]), run.model)
    assert all(channel.error is None for channel in result.channels.values())
