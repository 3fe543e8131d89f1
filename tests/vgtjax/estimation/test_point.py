"""A linear problem that learns from moves: what it learns, and what it must not forget."""

import numpy as np
import pytest

from vgtjax.estimation import Point
from vgtjax.estimation.search._point import Secant

RNG = np.random.default_rng(11)
ROWS, COUNT = 40, 4
COLUMNS = RNG.normal(size=(ROWS, COUNT)) * [1.0, 1e3, 1e-3, 1.0]
REMAINS = RNG.normal(size=ROWS)
MOVE = np.array([0.3, -2e-4, 1e2, 0.1])
BENT = REMAINS + COLUMNS @ MOVE + RNG.normal(size=ROWS)


def jacobian(secant):
    """The columns of a problem, in all its rows."""
    return secant.basis @ secant.reduced.columns


@pytest.fixture
def start():
    return Secant.of(Point(REMAINS, COLUMNS))


def test_a_problem_in_few_rows_is_the_same(start):
    np.testing.assert_allclose(jacobian(start), COLUMNS, rtol=1e-12, atol=1e-12 * np.max(COLUMNS))
    np.testing.assert_allclose(start.basis @ start.reduced.residuals, REMAINS, rtol=1e-12)
    moved = REMAINS + COLUMNS @ MOVE
    assert start.reduced.promise(MOVE) == pytest.approx(moved @ moved - REMAINS @ REMAINS, rel=1e-12)


def test_a_linear_misfit_teaches_nothing(start):
    moved = start.moved(MOVE, REMAINS + COLUMNS @ MOVE)
    np.testing.assert_allclose(jacobian(moved), COLUMNS, atol=1e-11 * np.max(COLUMNS))


def test_after_a_move_columns_say_what_the_misfit_did_along_it(start):
    moved = start.moved(MOVE, BENT)
    np.testing.assert_allclose(moved.basis @ moved.reduced.residuals, BENT, rtol=1e-11)
    np.testing.assert_allclose(jacobian(moved) @ MOVE, BENT - REMAINS, rtol=1e-10)


def test_directions_that_look_otherwise_are_not_touched(start):
    across = np.array([0.1, 0.2, -30.0, 0.4])
    along = COLUMNS @ MOVE
    across = across - MOVE * (along @ COLUMNS @ across) / (along @ along)
    moved = start.moved(MOVE, BENT)
    np.testing.assert_allclose(jacobian(moved) @ across, COLUMNS @ across, atol=1e-10)


def test_what_is_learned_does_not_depend_on_units(start):
    units = np.array([10.0, 1e-4, 1e5, 0.1])
    other = Secant.of(Point(REMAINS, COLUMNS * units)).moved(MOVE / units, BENT)
    expected = jacobian(start.moved(MOVE, BENT)) * units
    np.testing.assert_allclose(jacobian(other), expected, rtol=1e-9, atol=1e-9)


def test_a_second_move_keeps_what_the_first_one_taught(start):
    """Where the second looks otherwise."""
    first = start.moved(MOVE, BENT)
    along = jacobian(first) @ MOVE
    across = np.array([0.5, 1e-4, 10.0, -0.2])
    across = across - MOVE * (along @ jacobian(first) @ across) / (along @ along)
    second = first.moved(across, RNG.normal(size=ROWS))
    np.testing.assert_allclose(jacobian(second) @ MOVE, BENT - REMAINS, rtol=1e-9)
    assert second.reduced.columns.shape == (COUNT + 3, COUNT)


def test_damped_steps_are_those_of_levenberg_and_marquardt(start):
    sizes = [1e-2, 1.0, 1e3]
    found = start.reduced.damped_steps(sizes)
    for size, step in zip(sizes, found, strict=True):
        normal = COLUMNS.T @ COLUMNS / ROWS + np.eye(COUNT) / size
        np.testing.assert_allclose(step, -np.linalg.solve(normal, COLUMNS.T @ REMAINS / ROWS), rtol=1e-6)


def test_a_column_that_is_not_finite_does_not_move():
    broken = np.where(np.arange(COUNT) == 1, np.nan, COLUMNS)
    reduced = Secant.of(Point(REMAINS, broken)).reduced
    assert np.all(np.isfinite(reduced.columns))
    assert reduced.damped_steps([1.0])[0][1] == 0.0
