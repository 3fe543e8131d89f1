"""Steps of corrections on problems whose misfit is known, and computations that ask side by side."""

import numpy as np
import pytest
from known_problem import Known, driven

from vgtjax.estimation import Evaluated, Point, side_by_side
from vgtjax.estimation.search._corrections import trusted
from vgtjax.parameters import Transform

HERE = np.array([1.0, 0.5])


def free():
    return Transform(np.zeros(2, bool), np.ones(2), np.full(2, -np.inf), np.full(2, np.inf))


def step_of(function, columns):
    """Where `trusted` goes from `HERE`, and where the full linear step would."""
    point = Point(function(HERE), columns)
    full = -np.linalg.lstsq(columns, point.residuals)[0]
    problem = Known(lambda seen: function(seen[0]), free(), 2)
    return driven(trusted(problem, point, HERE, full, 1.0), problem), HERE + full


def linear(x):
    return np.array([20.0 * (x[0] - 0.9), 3.0 * (x[1] - 0.3)])


def test_a_full_step_is_taken_where_the_misfit_bears_it_out():
    there, full = step_of(linear, np.diag([20.0, 3.0]))
    np.testing.assert_allclose(there, full, atol=1e-12)
    np.testing.assert_allclose(there, [0.9, 0.3], atol=1e-12)


def test_a_direction_that_hardly_shows_does_not_spoil_the_others():
    """The derivative of the second is a thousandth of what it is soon after: a full step would carry it away."""

    def function(x):
        return np.array([20.0 * (x[0] - 0.9), 0.3 + 1e-3 * (x[1] - 0.5) + 40.0 * min(x[1] - 0.49, 0.0)])

    there, full = step_of(function, np.diag([20.0, 1e-3]))
    assert abs(full[1] - HERE[1]) > 100
    assert there[0] == pytest.approx(0.9, abs=1e-3), "what is told is followed"
    assert abs(there[1] - HERE[1]) < 0.02, "a damping of 1/100 lets it go 0.3e-3 / 2 * 100 = 0.015 at most"
    assert np.sum(function(there) ** 2) < np.sum(function(HERE) ** 2)


def test_where_simulations_fail_a_shorter_step_is_taken():
    def function(x):
        return linear(x) if x[1] > 0.4 else np.full(2, np.nan)

    there, _ = step_of(function, np.diag([20.0, 3.0]))
    assert np.all(np.isfinite(function(there)))
    assert np.sum(function(there) ** 2) < np.sum(function(HERE) ** 2)


def test_nowhere_is_an_answer():
    """A model whose derivatives point the wrong way: no step lowers the misfit, so none is taken."""
    there, _ = step_of(lambda x: -30.0 * (x - HERE) + np.array([5.0, 5.0]), np.diag([30.0, 30.0]))
    np.testing.assert_array_equal(there, HERE)


def asking(*places):
    """Asks of one place after the other, and brings the answers home."""
    found = []
    for place in places:
        (answer,) = yield (place,)
        found.append(answer.observed[0])
    return found


def test_side_by_side_asks_at_once_and_gives_each_its_own():
    rounds = []

    def drive(computation):
        answers = None
        while True:
            try:
                asked = computation.send(answers)
            except StopIteration as end:
                return end.value
            rounds.append(list(asked))
            answers = [Evaluated([np.array(-each)], []) for each in asked]

    found = drive(side_by_side([asking(1, 2, 3), asking(), asking(10), asking(20, 30)]))
    assert rounds == [[1, 10, 20], [2, 30], [3]]
    assert found == [[-1, -2, -3], [], [-10], [-20, -30]]
