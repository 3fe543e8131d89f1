"""How well the errors of the parameters leave simulated traces known."""

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax.estimation import calibrate, plan_task
from vgtjax.estimation.errors._bands import spread_along


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


def test_units_do_not_matter():
    """A stiffness beside a coefficient of the fourth power of the duty: variances 24 orders apart, and correlated to a
    millionth. What the rows of the least squares themselves say of a sample is at most their noise."""
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(400, 6))
    rows[:, 1] = rows[:, 0] + 1e-6 * rows[:, 1]
    units = 10.0 ** np.array([3, 3, -9, 0, -5, 1])
    covariance = np.linalg.inv(rows.T @ rows)
    told = spread_along(rows / units, covariance * np.outer(units, units))
    # The leverage of each row, by an orthonormal basis; the inverse has lost six digits of twelve.
    expected = np.linalg.norm(np.linalg.qr(rows)[0], axis=1)
    np.testing.assert_allclose(told, expected, rtol=1e-3)
    assert np.all(told <= 1)


def test_a_band_has_as_much_as_there_are_parameters(run):
    """Squares of what parameters leave open, in units of the noise, sum to the number of parameters along what was
    fitted; somewhat more here, as a constant along a trace is told by no sensor whose offset is free."""
    fitted = next(result for result in run.traces if result.use == "fit")
    total = sum(np.sum(np.square(channel.error / channel.noise)) for channel in fitted.channels.values())
    assert 0.5 * len(FREE) < total < 5 * len(FREE)


def test_a_comparison_without_a_fit_has_none(run):
    (result,) = vgtjax.estimation.compare(plan_task(run.model, [bench(0)], free=[]), run.model)
    assert all(channel.error is None for channel in result.channels.values())
