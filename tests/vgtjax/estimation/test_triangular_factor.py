"""A triangle of many rows by Cholesky's factors, beside the one by reflections."""

import numpy as np
import pytest

from vgtjax.estimation import _least_squares, estimate_uncertainty
from vgtjax.estimation._least_squares import reduce_rows

ROWS, UNKNOWNS = 500, 6


def columns(condition, rng):
    """Directions of all lengths, the weakest smaller than the strongest by the condition, in units far apart."""
    rows = np.linalg.qr(rng.normal(size=(ROWS, UNKNOWNS)))[0]
    ways = np.linalg.qr(rng.normal(size=(UNKNOWNS, UNKNOWNS)))[0]
    return rows @ np.diag(np.geomspace(1, 1 / condition, UNKNOWNS)) @ ways * np.geomspace(1e-8, 1e8, UNKNOWNS)


def of_positive_diagonal(triangle):
    return triangle * np.where(np.diag(triangle) < 0, -1.0, 1.0)[:, None]


def triangular_factor(matrix):
    last, others = reduce_rows(matrix[:, -1], matrix[:, :-1])
    return np.column_stack([others, last])


@pytest.mark.parametrize("condition", [1.0, 1e4, 1e6, 1e9, 1e15])
def test_it_is_that_of_reflections(condition):
    matrix = columns(condition, np.random.default_rng(1))
    expected = of_positive_diagonal(np.linalg.qr(matrix, mode="r"))
    lengths = np.linalg.norm(expected, axis=0)
    # Either is as far from the exact one as rounding times the condition.
    np.testing.assert_allclose(
        of_positive_diagonal(triangular_factor(matrix)) / lengths, expected / lengths, atol=1e-15 * condition + 1e-14
    )


def test_a_weak_direction_keeps_its_size():
    """What decides whether a parameter is estimable."""
    matrix = columns(1e6, np.random.default_rng(2))
    lengths = np.linalg.norm(matrix, axis=0)
    weakest = np.linalg.svd(triangular_factor(matrix) / lengths, compute_uv=False)[-1]
    assert weakest == pytest.approx(np.linalg.svd(matrix / lengths, compute_uv=False)[-1], rel=1e-8)


def test_a_column_of_zeros_stays_one():
    matrix = columns(10.0, np.random.default_rng(3))
    matrix[:, 2] = 0.0
    triangle = triangular_factor(matrix)
    assert not np.any(triangle[:, 2])
    np.testing.assert_allclose(triangle.T @ triangle, matrix.T @ matrix, rtol=1e-12)


@pytest.mark.parametrize("rows", [UNKNOWNS - 2, UNKNOWNS])
def test_few_rows(rows):
    matrix = columns(10.0, np.random.default_rng(4))[:rows]
    triangle = triangular_factor(matrix)
    lengths = np.linalg.norm(matrix, axis=0)
    np.testing.assert_allclose(
        (triangle / lengths).T @ (triangle / lengths), (matrix / lengths).T @ (matrix / lengths), atol=1e-14
    )


def test_many_rows_are_worked_on_in_blocks(monkeypatch):
    matrix = columns(1e4, np.random.default_rng(6))
    whole = triangular_factor(matrix)
    monkeypatch.setattr(_least_squares, "BLOCK", 64)  # the last block has fewer rows
    np.testing.assert_allclose(triangular_factor(matrix), whole, rtol=1e-9)


def test_a_column_that_is_not_finite_becomes_zeros():
    matrix = columns(10.0, np.random.default_rng(7))
    with_zeros = np.where(np.arange(UNKNOWNS) == 1, 0.0, matrix)
    matrix[3, 1] = np.nan
    for triangle in (triangular_factor(matrix), triangular_factor(with_zeros)):
        assert not np.any(triangle[:, 1])
        np.testing.assert_allclose(triangle.T @ triangle, with_zeros.T @ with_zeros, rtol=1e-12)


def test_values_beyond_their_squares():
    """Columns whose squares are no numbers tell nothing; a target of such a size keeps what is left of it."""
    matrix = columns(10.0, np.random.default_rng(5))
    triangle = triangular_factor(1e200 * matrix)
    assert not np.any(triangle[:, :-1])
    assert np.linalg.norm(triangle[:, -1] / 1e200) == pytest.approx(np.linalg.norm(matrix[:, -1]), rel=1e-12)


@pytest.mark.parametrize("size", [1e160, 1e300, np.inf, np.nan])
def test_an_exploded_column_spoils_no_other(size):
    """Its square is no number; next to its length every other would be too short to matter."""
    rng = np.random.default_rng(3)
    matrix, residuals = rng.normal(size=(ROWS, UNKNOWNS)), rng.normal(size=ROWS)
    exploded = matrix.copy()
    exploded[:, 2] = size * matrix[:, 2]
    found = estimate_uncertainty(*reduce_rows(residuals, exploded), ROWS)
    expected = estimate_uncertainty(*reduce_rows(residuals, np.delete(matrix, 2, axis=1)), ROWS)
    assert found.estimable.tolist() == [True, True, False, True, True, True]
    np.testing.assert_allclose(np.delete(found.values, 2), expected.values, rtol=1e-10)  # rounding
    np.testing.assert_allclose(np.delete(found.std_errors, 2), expected.std_errors, rtol=1e-10)
