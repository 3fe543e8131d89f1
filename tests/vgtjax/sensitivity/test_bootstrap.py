"""Intervals hold the true value as often as they say."""

import numpy as np
import pytest

from vgtjax import InputError
from vgtjax.sensitivity import (
    bootstrap,
    elementary_effects,
    first_order,
    regress,
    squared_correlation,
    total_bound,
    total_order,
    variance,
)
from vgtjax.sensitivity._resampling import resampled_weights


def covered(estimate, truth):
    """Part of the repetitions, along the first axis, whose interval holds the truth."""
    return np.mean((estimate.low <= truth) & (truth <= estimate.high), axis=0)


def product(u):
    """`z1 + z1 z2` of centred inputs of variance one: first-order indices 1/2 and 0, total ones 1 and 1/2."""
    z = np.sqrt(12) * (u - 0.5)
    return z[..., 0] * (1 + z[..., 1])


def radial_repetitions(base, count):
    """Random radial designs, one a column."""
    u_a, u_b = np.random.default_rng(0).random((2, count, base, 2))
    rows = [u_a, np.stack([u_b[..., 0], u_a[..., 1]], axis=-1), np.stack([u_a[..., 0], u_b[..., 1]], axis=-1), u_b]
    a, *ab, b = (product(u).T for u in rows)
    return a, np.stack(ab, axis=1), b


def test_coverage_of_variance_based_indices():
    a, ab, b = radial_repetitions(base=256, count=600)

    def statistics(weights):
        return {"first": first_order(a, ab, b, weights), "total": total_order(a, ab, b, weights)}

    found = bootstrap(statistics, 256)
    # 600 repetitions know a coverage of 0.95 to 0.009. Percentile intervals of skewed means fall a little short.
    for name, truth in (("first", [0.5, 0.0]), ("total", [1.0, 0.5])):
        rate = covered(found[name], np.array(truth))
        assert np.all((rate > 0.91) & (rate < 0.98)), (name, rate)


def test_coverage_of_correlation_and_regression():
    """Two correlated inputs and noise: known coefficients, R2, and squared correlations."""
    rng = np.random.default_rng(1)
    mixing = np.array([[1.0, 0.0], [0.6, 0.8]])
    slopes = np.array([1.0, 0.5])
    among = mixing @ mixing.T
    whole = slopes @ among @ slopes + 1.0
    truths = {
        "regression": slopes / np.sqrt(whole),
        "r2": (whole - 1.0) / whole,
        "correlation": (among @ slopes) ** 2 / whole,
    }
    hits = {name: [] for name in truths}
    for _ in range(300):
        x = rng.normal(size=(100, 2)) @ mixing.T
        y = (x @ slopes + rng.normal(size=100))[:, None]

        def statistics(weights, x=x, y=y):
            fit = regress(x, y, weights)
            return {
                "regression": fit.coefficients,
                "r2": fit.r2,
                "correlation": squared_correlation(x, y, weights),
            }

        for name, estimate in bootstrap(statistics, 100, replicates=100).items():
            hits[name].append((estimate.low[0] <= truths[name]) & (truths[name] <= estimate.high[0]))
    for name, hit in hits.items():
        rate = np.mean(hit, axis=0)
        # 300 repetitions know a coverage of 0.95 to 0.013; a hundred points and replicates cost another few percent.
        assert np.all((rate > 0.89) & (rate < 0.99)), (name, rate)


def test_coverage_of_indices_whose_rows_were_drawn_together():
    """With eight inputs, most rows of a base point are nearly copies of A; resampling rows would be far too sure."""
    u_a, u_b = np.random.default_rng(3).random((2, 250, 64, 2))
    rows = [u_a, np.stack([u_b[..., 0], u_a[..., 1]], axis=-1), np.stack([u_a[..., 0], u_b[..., 1]], axis=-1), u_b]
    together = np.stack([*rows, *[u_a] * 6], axis=2)  # the other six inputs do nothing
    hits, naive = [], []
    for x in together:
        y = product(x)[:, :, None]
        flat_x, flat_y = x.reshape(-1, 2), y.reshape(-1, 1)
        for found, how, points in ((hits, (x, y), 64), (naive, (flat_x, flat_y), 640)):
            estimate = bootstrap(lambda w, how=how: {"r2": regress(*how, w).r2}, points, replicates=100)["r2"]
            found.append(estimate.low <= 0.5 <= estimate.high)
    # 250 repetitions know a coverage to 0.014; sixty-four skewed points and a hundred replicates cost a few percent.
    assert 0.87 < np.mean(hits) < 0.99
    assert np.mean(naive) < np.mean(hits) - 0.1


def test_coverage_of_elementary_effects():
    rng = np.random.default_rng(2)
    u_a, u_b = rng.random((2, 200, 1))
    # The effect of the input is another, hidden one, whose mean is 1/2; one repetition a column.
    hidden = rng.random((200, 600))
    ab = (u_b - u_a)[:, :, None] * hidden[:, None, :]

    def statistics(weights):
        return {"mu_star": elementary_effects(u_a, u_b, np.zeros((200, 600)), ab, weights).mu_star}

    rate = covered(bootstrap(statistics, 200)["mu_star"], 0.5)
    assert np.all((rate > 0.91) & (rate < 0.98)), rate  # as above


def test_the_level_is_that_of_the_interval():
    values = np.random.default_rng(3).normal(size=(400, 500))

    def statistics(weights):
        return {"mean": weights @ values}

    rate = covered(bootstrap(statistics, 400, level=0.5)["mean"], 0.0)
    assert rate == pytest.approx(0.5, abs=0.07)  # 500 repetitions know it to 0.022; three of them


def test_weights_are_those_of_a_resample():
    weights = np.concatenate(list(resampled_weights(50, 300, seed=0)))
    assert weights.shape == (300, 50)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)  # rounding
    np.testing.assert_allclose(weights * 50, np.round(weights * 50), atol=1e-12)
    # A multinomial count of 50 draws has the variance 50 (1/50)(49/50); 15000 counts know it to 2 %.
    assert np.var(weights * 50) == pytest.approx(0.98, rel=0.06)


def test_weights_do_not_depend_on_how_many_are_made_at_a_time(monkeypatch):
    whole = np.concatenate(list(resampled_weights(50, 300, seed=4)))
    monkeypatch.setattr("vgtjax.sensitivity._resampling._CHUNK", 50 * 7)
    parts = list(resampled_weights(50, 300, seed=4))
    assert len(parts) == 43
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_weights_do_what_repeating_the_points_does():
    """For every statistic, so that a replicate is what the same estimator makes of a resample."""
    rng = np.random.default_rng(6)
    drawn = rng.integers(40, size=40)
    weights = np.bincount(drawn, minlength=40)[None] / 40
    u_a = rng.uniform(0.0, 0.4, (40, 3))
    u_b = u_a + rng.uniform(0.1, 0.5, (40, 3))  # no step is left out, so that their number is the same
    x = np.concatenate([u_a[:, None], np.where(np.eye(3), u_b[:, None], u_a[:, None]), u_b[:, None]], axis=1)
    y = 5.0 + np.stack([np.exp(x @ [1.0, 2.0, 3.0]), x[..., 0] * x[..., 1]], axis=-1)
    a, ab, b = y[:, 0], y[:, 1:-1], y[:, -1]
    cases = [
        (variance, (y,)),
        (squared_correlation, (x, y)),
        (lambda *given: vars(regress(*given)), (x, y)),
        (first_order, (a, ab, b)),
        (total_order, (a, ab, b)),
        (lambda *given: vars(elementary_effects(*given)), (u_a, u_b, a, ab)),
        (lambda slopes, w=None: total_bound(slopes, np.ones(3), np.ones(2), 1.0, w), (np.swapaxes(ab, 1, 2),)),
    ]
    for statistic, given in cases:
        weighted, repeated = statistic(*given, weights), statistic(*[part[drawn] for part in given])
        pairs = [(weighted[name], repeated[name]) for name in weighted] if isinstance(weighted, dict) else None
        for ours, expected in pairs or [(weighted, repeated)]:
            np.testing.assert_allclose(ours[0], expected, rtol=1e-8)  # the ridge of regression acts in other directions


def test_the_value_is_the_statistic_itself():
    a, ab, b = radial_repetitions(base=64, count=3)
    found = bootstrap(lambda weights: {"total": total_order(a, ab, b, weights)}, 64, seed=1)["total"]
    np.testing.assert_allclose(found.value, total_order(a, ab, b), rtol=1e-12)  # rounding
    assert np.all((found.low < found.value) & (found.value < found.high))


def test_settings_that_make_no_interval_are_refused():
    with pytest.raises(InputError, match="at least 20 replicates, but 19 were asked for"):
        bootstrap(lambda weights: {}, 10, replicates=19)
    with pytest.raises(InputError, match="must lie between 0 and 1, but it is 95"):
        bootstrap(lambda weights: {}, 10, level=95)
