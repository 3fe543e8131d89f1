"""Samples of the unit cube: their order, their strata, and that slices of them don't matter."""

import numpy as np
import pytest
from scipy.stats import chi2, qmc

from vgtjax import InputError
from vgtjax.population import (
    LatinHypercubeSample,
    SobolSample,
    _permutation as permutation,
    _sampling as sampling,
    make_sample,
)
from vgtjax.sensitivity import RadialDesign

SAMPLES = [
    RadialDesign(dimensions=3, base=13, seed=5),
    SobolSample(dimensions=4, size=61, seed=5),
    LatinHypercubeSample(dimensions=4, size=61, seed=5),
]


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: type(sample).__name__)
def test_slices_do_not_change_a_bit(sample):
    whole = sample.points(0, sample.rows)
    assert whole.shape == (sample.rows, sample.dimensions)
    for size in (1, 2, 3, 7, 50):
        parts = [sample.points(begin, min(begin + size, sample.rows)) for begin in range(0, sample.rows, size)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert sample.points(4, 4).shape == (0, sample.dimensions)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: type(sample).__name__)
def test_another_seed_is_another_sample(sample):
    other = type(sample)(sample.dimensions, getattr(sample, "base", None) or sample.size, seed=6)
    assert not np.any(other.points(0, 20) == sample.points(0, 20))


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: type(sample).__name__)
def test_rows_that_do_not_exist_are_refused(sample):
    with pytest.raises(InputError, match=f"between 0 and {sample.rows}, but 3 to {sample.rows + 1} were asked for"):
        sample.points(3, sample.rows + 1)


def test_radial_rows_are_a_then_ab_then_b():
    design = RadialDesign(dimensions=3, base=4, seed=1)
    a, b = design.base_points(0, 4)
    rows = design.points(0, design.rows).reshape(4, 5, 3)
    np.testing.assert_array_equal(rows[:, 0], a)
    np.testing.assert_array_equal(rows[:, 4], b)
    for i in range(3):
        expected = a.copy()
        expected[:, i] = b[:, i]
        np.testing.assert_array_equal(rows[:, 1 + i], expected)


def test_first_base_points_are_a_smaller_design():
    design = RadialDesign(dimensions=3, base=16, seed=1)
    small = design.prefix(6)
    np.testing.assert_array_equal(small.points(0, small.rows), design.points(0, small.rows))
    with pytest.raises(InputError, match="between 1 and 16, but it is 17"):
        design.prefix(17)


def test_split_undoes_the_order_of_rows():
    design = RadialDesign(dimensions=3, base=4, seed=1)
    a, ab, b = design.split(design.points(0, design.rows))
    np.testing.assert_array_equal(a, design.base_points(0, 4)[0])
    np.testing.assert_array_equal(b, design.base_points(0, 4)[1])
    np.testing.assert_array_equal(np.diagonal(ab, axis1=1, axis2=2), b)
    with pytest.raises(InputError, match=r"must have the shape \(20, columns\), but theirs is \(19, 2\)"):
        design.split(np.zeros((19, 2)))


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64, 1000])
def test_latin_hypercube_has_one_point_a_stratum(size):
    points = LatinHypercubeSample(dimensions=20, size=size, seed=3).points(0, size)
    strata = np.floor(points * size).astype(int)
    np.testing.assert_array_equal(np.sort(strata, axis=0), np.tile(np.arange(size)[:, None], 20))


def test_latin_hypercube_columns_are_not_correlated():
    points = LatinHypercubeSample(dimensions=40, size=500, seed=3).points(0, 500)
    off_diagonal = np.corrcoef(points.T)[np.triu_indices(40, k=1)]
    # Of 780 coefficients with deviation 1/sqrt(500), the largest is near 3.2 deviations.
    assert np.max(np.abs(off_diagonal)) < 4.5 / np.sqrt(500)
    # Their mean square is 1/500 within sqrt(2/780), of which four are allowed.
    assert np.mean(off_diagonal**2) * 500 == pytest.approx(1.0, abs=4 * np.sqrt(2 / 780))


def test_place_within_a_stratum_is_uniform():
    points = LatinHypercubeSample(dimensions=20, size=1000, seed=3).points(0, 1000)
    counts = np.bincount((10 * np.mod(points * 1000, 1.0)).astype(int).ravel(), minlength=10)
    assert np.sum((counts - 2000) ** 2 / 2000) < chi2.isf(1e-3, df=9)  # one seed in a thousand would fail


@pytest.mark.parametrize("size", [2, 3, 4, 5, 6, 10, 30])
def test_small_permutations_send_every_element_everywhere(size):
    columns = 20000
    keys = permutation.random_keys(2, permutation.ROUNDS, columns)
    sent = permutation.permute(np.arange(size, dtype=np.uint64), size, keys).astype(int)
    counts = np.stack([np.bincount(row, minlength=size) for row in sent])
    expected = columns / size
    statistic = np.sum((counts - expected) ** 2 / expected)
    # Rows and columns of the table have given sums, so its scaled chi-square has (size - 1)^2 degrees of freedom.
    assert statistic * (size - 1) / size < chi2.isf(1e-3, df=(size - 1) ** 2)


def test_one_slice_of_a_large_hypercube_takes_no_table_of_the_whole():
    sample = LatinHypercubeSample(dimensions=5, size=2**30, seed=3)
    last = sample.points(sample.rows - 4, sample.rows)  # a table would have 40 GiB
    assert last.shape == (4, 5)
    assert len(np.unique(last)) == 20


def test_a_sobol_point_at_the_corner_is_moved_inside(monkeypatch):
    """Without scrambling, the first point is zero exactly."""
    corner = qmc.Sobol
    monkeypatch.setattr(qmc, "Sobol", lambda d, scramble, bits, rng: corner(d, scramble=False, bits=bits))
    np.testing.assert_array_equal(sampling.sobol_points(3, 0, 0, 1), np.full((1, 3), 2.0**-31))
    assert (2**30 - 1) / 2**30 + 2.0**-31 < 1.0


@pytest.mark.parametrize("word", [0, 2**64 - 1])
@pytest.mark.parametrize("size", [1, 3, 2**30 - 1, 2**30])
def test_a_hypercube_point_at_the_edge_of_its_stratum_stays_inside(monkeypatch, word, size):
    sample = LatinHypercubeSample(dimensions=1, size=size, seed=3)
    monkeypatch.setattr(sampling, "permute", lambda index, size, keys: index[:, None])
    monkeypatch.setattr(sampling, "random_words", lambda index, key: np.full_like(index, word))
    for row in (0, size - 1):
        point = sample.points(row, row + 1)
        assert 0.0 < point < 1.0
        assert np.floor(point * size) == row


def test_sizes_out_of_range_are_refused():
    with pytest.raises(
        InputError, match="number of inputs of a radial design must be between 1 and 10600, but it is 0"
    ):
        RadialDesign(dimensions=0, base=8, seed=0)
    with pytest.raises(InputError, match="number of base points must be between 1 and 1073741824, but it is 0"):
        RadialDesign(dimensions=3, base=0, seed=0)
    with pytest.raises(InputError, match="dimensions of Sobol' points must be between 1 and 21201, but it is 21202"):
        SobolSample(dimensions=21202, size=8, seed=0)
    with pytest.raises(InputError, match="size of a sample must be between 1 and 1073741824, but it is 0"):
        LatinHypercubeSample(dimensions=3, size=0, seed=0)


def test_a_sample_is_chosen_by_name():
    assert make_sample(3, 8) == SobolSample(dimensions=3, size=8, seed=0)
    assert make_sample(3, 8, "latin-hypercube", 5) == LatinHypercubeSample(dimensions=3, size=8, seed=5)
    with pytest.raises(InputError, match="must be one of sobol, latin-hypercube, but it is 'halton'; choose one"):
        make_sample(3, 8, "halton")
