"""A trace left out of a linear problem, to first order: exactly what a fit of the others predicts."""

import numpy as np
import pytest

from vgtjax.estimation import BLOCKS, Weighed


def weighed(columns, residuals, traces, distances=(), prior=None):
    trace = np.repeat(np.arange(traces), len(residuals) // traces)
    block = BLOCKS * trace + np.tile(np.arange(len(residuals) // traces) * BLOCKS * traces // len(residuals), traces)
    prior = np.zeros((0, columns.shape[1])) if prior is None else prior
    return Weighed(residuals, columns, np.array(distances, float), prior, trace, block, len(residuals))


@pytest.fixture
def problem():
    rng = np.random.default_rng(3)
    columns, target = rng.normal(size=(192, 5)) * np.array([1.0, 1e4, 1e-3, 1.0, 1.0]), rng.normal(size=192)
    return columns, target - columns @ np.linalg.lstsq(columns, target)[0]


@pytest.mark.parametrize("from_the_end", [0.0, 1.0])
def test_a_trace_left_out_is_predicted_by_the_others(problem, from_the_end):
    """From the end of the linear problem, and from so many units off along every column."""
    columns, residuals = problem
    residuals = residuals + from_the_end * np.sum(columns / np.linalg.norm(columns, axis=0), axis=1)
    found = weighed(columns, residuals, 3)
    for trace in range(3):
        mine = found.trace == trace
        step = np.linalg.lstsq(columns[~mine], -residuals[~mine])[0]
        predicted = residuals[mine] + columns[mine] @ step
        blocks = slice(BLOCKS * trace, BLOCKS * (trace + 1))
        np.testing.assert_allclose(np.sum(found.left_out[blocks]), predicted @ predicted, rtol=1e-9)
    assert np.sum(found.left_out) > found.chi2 == pytest.approx(np.sum(found.by_block))


def test_derivatives_that_are_a_little_off_leave_the_prediction_as_it_is(problem):
    """What others hardly tell is theirs to say: the trace itself pulls along it by what its own derivatives get wrong,
    which was taken for the others' a hundred times as large."""
    columns, residuals = problem
    columns[64:, 1] *= 0.4  # the first trace tells three quarters of this one
    residuals = residuals - columns @ np.linalg.lstsq(columns, residuals)[0]
    wrong = columns.copy()
    wrong[:64, 1] += 0.2 * np.linalg.norm(columns[:64, 1]) * residuals[:64] / np.linalg.norm(residuals[:64])
    exact, found = (np.sum(weighed(each, residuals, 3).left_out[:BLOCKS]) for each in (columns, wrong))
    # Derivatives that are a fifth off move the prediction by some tenths, and not tenfold.
    assert exact == pytest.approx(found, rel=0.5)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.2])
def test_what_one_trace_nearly_alone_tells_stays(problem, part):
    """What others have a tenth of they would tell by chance: ten of chi^2 in the mean, and as much more or less."""
    columns, _ = problem
    columns[64:, 1] *= part
    residuals = np.random.default_rng(4).normal(size=192)
    residuals -= columns @ np.linalg.lstsq(columns, residuals)[0]
    others = np.delete(columns, 1, axis=1)
    step = np.linalg.lstsq(others[64:], -residuals[64:])[0]
    predicted = residuals[:64] + others[:64] @ step
    np.testing.assert_allclose(
        np.sum(weighed(columns, residuals, 3).left_out[:BLOCKS]), predicted @ predicted, rtol=0.2
    )


def test_what_is_known_beforehand_predicts_as_another_row(problem):
    """Of a value that one trace alone tells, and that is known to a tenth of what this says of it."""
    columns, target = problem
    columns[64:, 1] = 0.0
    prior, distances = np.zeros((5, 5)), np.zeros(5)
    prior[1, 1] = 10 * np.linalg.norm(columns[:, 1])
    every, seen = np.vstack([columns, prior]), np.append(target, distances)
    left = seen - every @ np.linalg.lstsq(every, seen)[0]
    found = weighed(columns, left[:192], 3, left[192:], prior)
    step = np.linalg.lstsq(every[64:], -left[64:])[0]
    predicted = left[:64] + columns[:64] @ step
    assert np.sum(found.left_out[:BLOCKS]) == pytest.approx(predicted @ predicted, rel=1e-9)
    assert found.uncertainty.gain == pytest.approx(0.0, abs=1e-9)
    assert (found.rank, found.uncertainty.rank) == (5, 5)
    # The noise is one here; without its prior the value has an error ten times as large.
    assert found.uncertainty.std_errors[1] == pytest.approx(1 / prior[1, 1], rel=0.01)
    assert found.misfit(4.0) - found.chi2 / 4 == pytest.approx(left[192:] @ left[192:])
