"""Means of derivatives over places, at one of which they may explode."""

from types import SimpleNamespace

import numpy as np
import pytest

from vgtjax import SimulationError
from vgtjax.estimation import run_alone
from vgtjax.estimation.derivatives._mean_columns import mean_columns


def drawn(seed):
    """Two bundles of derivatives, the second of two lanes, with respect to three parameters."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(1.0, 2.0, (1, 20, 2, 3)), rng.uniform(1.0, 2.0, (2, 5, 2, 3))]


def place(columns, *, failed=False):
    """A place that answers with these derivatives."""

    def asked():
        return SimpleNamespace(columns=columns, failed=failed)
        yield

    return asked


def unsimulated():
    raise SimulationError("no state")
    yield


def mean_of(own, *others, believed=None):
    return run_alone(mean_columns(own, others, [np.ones(1)] * len(others), believed))


def test_places_that_agree_count_alike():
    columns, believed = mean_of(drawn(0), place(drawn(1)), place(drawn(2)))
    for found, *each in zip(columns, drawn(0), drawn(1), drawn(2), strict=True):
        np.testing.assert_allclose(found, np.mean(each, axis=0), rtol=1e-15)
    assert all(np.all(rows) for rows in believed)


def test_rows_that_explode_at_one_place_are_left_out_there():
    wild = drawn(1)
    wild[0][0, 7, 1] *= 1e9
    columns, believed = mean_of(drawn(0), place(wild), place(drawn(2)))
    expected = np.mean([drawn(0)[0], drawn(1)[0], drawn(2)[0]], axis=0)
    expected[0, 7, 1] = np.mean([drawn(0)[0][0, 7, 1], drawn(2)[0][0, 7, 1]], axis=0)
    np.testing.assert_allclose(columns[0], expected, rtol=1e-14)
    assert np.argwhere(~believed[0]).tolist() == [[1, 0, 7, 1]]
    assert np.all(believed[1])


def test_rows_that_explode_are_left_out_where_but_one_other_place_can_be_simulated():
    wild = drawn(1)
    wild[0][0, 7, 1] *= 1e6
    columns, believed = mean_of(drawn(0), place(wild), unsimulated, place(drawn(2), failed=True))
    np.testing.assert_array_equal(columns[0][0, 7, 1], drawn(0)[0][0, 7, 1])
    assert np.argwhere(~believed[0][:2]).tolist() == [[1, 0, 7, 1]]


@pytest.mark.parametrize("explodes", [np.inf, np.nan, 1e200])
def test_an_end_that_explodes_is_left_out_as_well(explodes):
    own = drawn(0)
    own[1][1, 2:] = explodes
    columns, _ = mean_of(own, place(drawn(1)), place(drawn(2)))
    expected = np.mean([drawn(1)[1], drawn(2)[1]], axis=0)
    np.testing.assert_allclose(columns[1][1, 2:], expected[1, 2:], rtol=1e-15)


def test_a_combination_that_no_place_feels_is_not_felt_by_the_mean():
    """Medians of single numbers would feel it."""
    rng, nothing = np.random.default_rng(3), np.array([1.0, -2.0, 1.0])

    def unfelt():
        columns = rng.normal(size=(1, 200, 2, 3)) * np.exp(rng.normal(0, 3, (1, 200, 2, 1)))
        return [columns - (columns @ nothing)[..., None] * nothing / (nothing @ nothing)]

    columns, believed = mean_of(unfelt(), *(place(unfelt()) for _ in range(4)))
    assert not np.all(believed[0])
    assert np.max(np.abs(columns[0] @ nothing)) < 1e-12 * np.max(np.abs(columns[0]))  # rounding


def test_places_without_an_answer_are_left_out():
    lost = drawn(1)
    lost[0][..., 2] = np.nan  # a column that is finite at the end
    columns, _ = mean_of(drawn(0), place(drawn(1), failed=True), unsimulated, place(lost), place(drawn(2)))
    np.testing.assert_allclose(columns[0], np.mean([drawn(0)[0], drawn(2)[0]], axis=0), rtol=1e-15)


def test_other_columns_of_the_same_places_are_of_the_same_rows():
    wild = drawn(1)
    wild[0][0, 7, 1] *= 1e9
    _, believed = mean_of(drawn(0), place(wild), place(drawn(2)))
    delays = [[each[..., :1] for each in drawn(seed)] for seed in (5, 6, 7)]
    columns, _ = mean_of(delays[0], place(delays[1]), place(delays[2]), believed=believed)
    assert columns[0][0, 7, 1, 0] == pytest.approx(np.mean([delays[0][0][0, 7, 1, 0], delays[2][0][0, 7, 1, 0]]))
    assert columns[0][0, 8, 1, 0] == pytest.approx(np.mean([each[0][0, 8, 1, 0] for each in delays]))
