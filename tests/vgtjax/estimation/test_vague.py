"""What the traces hardly tell: it is called not determined, and corrections leave it where it is."""

import numpy as np
import pytest

from vgtjax.estimation import least_squares
from vgtjax.estimation._least_squares import VAGUE
from vgtjax.estimation.search._point import Point

ALL = np.array([True, True, True])
COLUMNS = np.array([[1000.0, 1000.0, 0.0], [0.1, -0.1, 0.0], [0.0, 0.0, 50.0], [30.0, 0.0, 20.0]])
"""The first two hardly differ, and the sum of these is well known."""


def test_an_interval_of_more_than_a_factor_of_ten_to_either_side_tells_nothing():
    found = least_squares(np.diag([1 / (0.99 * VAGUE), 1 / (1.01 * VAGUE), 0.0]), np.zeros(3))
    assert found.estimable.tolist() == [True, True, False]
    assert found.determined(ALL).tolist() == [True, False, False]
    # What is no logarithm may be zero, and has an interval whatever its length.
    assert found.determined(~ALL).tolist() == [True, True, False]
    assert np.exp(1.96 * VAGUE) == pytest.approx(10.0, rel=1e-4)  # as 1.96 is rounded


def test_the_combination_is_found_that_is_hardly_told():
    columns = np.delete(COLUMNS, 3, axis=0)
    found = least_squares(columns, np.zeros(3))
    direction = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    assert abs(found.vague(ALL) @ direction) == pytest.approx(1.0, rel=1e-6)  # its error is 5, that of the sum 0.001
    assert found.vague(np.array([False, False, True])).shape == (0, 3)
    assert least_squares(1e3 * columns, np.zeros(3)).vague(ALL).shape == (0, 3)


def test_what_is_held_stays_and_the_rest_goes_where_it_then_belongs():
    residuals = np.array([3.0, -2.0, 5.0, 1.0])
    point, direction = Point(residuals, COLUMNS), np.array([[1.0, -1.0, 0.0]]) / np.sqrt(2)
    found = point.holding(direction).uncertainty(4)
    # The same with one unknown in place of the two, as their difference stays.
    merged = np.column_stack([COLUMNS[:, 0] + COLUMNS[:, 1], COLUMNS[:, 2]])
    both, third = np.linalg.lstsq(merged, residuals, rcond=None)[0]
    # The held row is 1e4 standard deviations stiff: 1e-7 of what the step would move along it.
    np.testing.assert_allclose(found.values, [both, both, third], atol=1e-6 * np.max(np.abs(residuals)))
    assert point.holding(np.zeros((0, 3))) is point
