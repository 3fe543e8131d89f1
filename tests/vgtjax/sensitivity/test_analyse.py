"""All indices at once: the same as one by one, whatever is missing."""

import dataclasses

import numpy as np
import pytest
from sensitivity_systems import Ishigami

from vgtjax import InputError
from vgtjax.population import LatinHypercubeSample
from vgtjax.sensitivity import (
    RadialDesign,
    analyse,
    analyse_linear,
    elementary_effects,
    first_order,
    regress,
    squared_correlation,
    total_order,
)

INPUTS = ("a", "b[0]", "b[1]")
OUTPUTS = ("ishigami", "linear", "curve[0]", "curve[1]", "cosine")
"""Of the case; two of its outputs are called the points of a curve."""
DESIGN = RadialDesign(dimensions=3, base=64, seed=1)
INDICES = ("correlation", "regression", "r2", "adjusted_r2", "first", "total", "mu", "mu_star", "sigma")
ROUNDING = 1e-10  # matrix products of other shapes add in another order


@pytest.fixture(scope="module")
def case():
    """Inputs and five outputs of the design, and their indices."""
    function = Ishigami()
    x = function.inputs(DESIGN.points(0, DESIGN.rows))
    y = np.column_stack([function(x), x @ [1.0, 2.0, 0.0], np.exp(x[:, 0]), x[:, 0] * x[:, 1], np.cos(x[:, 2])])
    return x, y, analyse(DESIGN, x, y, inputs=INPUTS, outputs=OUTPUTS, replicates=50)


def assert_same(found, expected, columns, against=None):
    """All indices of some outputs are those of others."""
    for name in INDICES:
        for end in ("value", "low", "high"):
            ours, theirs = getattr(getattr(found, name), end), getattr(getattr(expected, name), end)
            np.testing.assert_allclose(ours[columns], theirs[columns if against is None else against], atol=ROUNDING)


def test_every_index_is_that_of_its_own_function(case):
    x, y, found = case
    a, ab, b = DESIGN.split(y)
    together = DESIGN.group(x), DESIGN.group(y)
    effects = elementary_effects(*DESIGN.base_points(0, 64), a, ab)
    fit = regress(*together)
    expected = {
        "correlation": squared_correlation(*together),
        "regression": fit.coefficients,
        "r2": fit.r2,
        "adjusted_r2": fit.adjusted_r2,
        "first": first_order(a, ab, b),
        "total": total_order(a, ab, b),
        **vars(effects),
    }
    assert set(expected) == set(INDICES) == {field.name for field in dataclasses.fields(found)} - {"used"}
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(found, name).value, value, atol=ROUNDING)
    np.testing.assert_array_equal(found.used, 64)


def test_indices_are_read_by_name(case):
    _, _, found = case
    for name in ("correlation", "total", "sigma"):
        index = getattr(found, name)
        for end in ("value", "low", "high"):
            values = getattr(index, end)
            assert getattr(index["cosine", "b[1]"], end) == values[4, 2]
            np.testing.assert_array_equal(getattr(index["linear"], end), values[1])
            np.testing.assert_array_equal(getattr(index["curve"], end), values[2:4])
            np.testing.assert_array_equal(getattr(index["curve", "a"], end), values[2:4, 0])
            np.testing.assert_array_equal(getattr(index["curve[1]", "b"], end), values[3, 1:])
    assert found.r2["linear"].value == found.r2.value[1]
    assert found.place("curve") == slice(2, 4)
    with pytest.raises(InputError, match="output 'curv' matches nothing; did you mean 'curve'"):
        found.total["curv"]
    with pytest.raises(InputError, match="input 'A' matches nothing"):
        found.total["linear", "A"]
    with pytest.raises(InputError, match="output 'sine' matches nothing; did you mean 'cosine'"):
        found.place("sine")


def test_indices_of_some_outputs_have_their_names(case):
    _, _, found = case
    some = found.select(["cosine", "curve"])
    assert some.outputs == ("cosine", "curve[0]", "curve[1]")
    assert some.inputs == INPUTS
    assert_same(some, found, slice(None), [4, 2, 3])
    together = type(found).joined([found.select(["ishigami", "linear"]), found.select(["curve", "cosine"])])
    assert together.outputs == OUTPUTS
    assert together.r2.inputs == ()
    assert_same(together, found, slice(None))


def test_indices_print_themselves(case):
    _, _, found = case
    title, head, *rows = repr(found).splitlines()
    assert title == "total index of 3 outputs and 1 curves by 3 inputs"
    assert head.split() == ["output", "points", "R2", "largest", "second", "third"]
    assert [row.split()[:2] for row in rows] == [["ishigami", "64"], ["linear", "64"], ["cosine", "64"]]
    # Of a + 2 b[0] with inputs that spread alike the shares are 1 / 5 and 4 / 5, and R2 is 1.
    total = found.total.value[1]
    order = np.argsort(-total)
    printed = [word for place in order for word in (INPUTS[place], f"{total[place]:.2f}")]
    assert rows[1].split()[2:] == ["1.00", *printed]
    assert printed[:3:2] == ["b[0]", "a"]
    assert "<td>cosine</td><td>64</td>" in found._repr_html_()


def test_rows_of_a_base_point_are_all_rows_of_the_regression(case):
    x, y, found = case
    scaled = np.column_stack([np.ones(len(x)), (x - x.mean(axis=0)) / x.std(axis=0)])
    solution = np.linalg.lstsq(scaled, y / y.std(axis=0))[0]
    np.testing.assert_allclose(found.regression.value, solution[1:].T, atol=ROUNDING)


def test_one_bad_row_takes_its_base_point_from_its_output_and_nothing_else(case):
    x, y, expected = case
    broken = y.copy()
    broken[17, 1] = np.nan  # base point 3
    found = analyse(DESIGN, x, broken, replicates=50)
    np.testing.assert_array_equal(found.used, [64, 63, 64, 64, 64])
    assert_same(found, expected, [0, 2, 3, 4])
    without = np.delete(np.arange(64), 3)
    a, ab, b = (part[without] for part in DESIGN.split(y))
    np.testing.assert_allclose(found.total.value[1], total_order(a, ab, b)[1], atol=ROUNDING)
    np.testing.assert_allclose(found.first.value[1], first_order(a, ab, b)[1], atol=ROUNDING)
    u_a, u_b = (u[without] for u in DESIGN.base_points(0, 64))
    np.testing.assert_allclose(found.sigma.value[1], elementary_effects(u_a, u_b, a, ab).sigma[1], atol=ROUNDING)
    fit = regress(DESIGN.group(x)[without], DESIGN.group(y)[without])
    np.testing.assert_allclose(found.adjusted_r2.value[1], fit.adjusted_r2[1], atol=ROUNDING)
    assert np.all(found.total.low[1] <= found.total.high[1])


def test_infinite_outputs_are_missing_too(case):
    x, y, _ = case
    broken, infinite = y.copy(), y.copy()
    broken[17, 1], infinite[17, 1] = np.nan, -np.inf
    settings = {"replicates": 20}
    assert_same(analyse(DESIGN, x, infinite, **settings), analyse(DESIGN, x, broken, **settings), slice(None))


def test_too_few_complete_points_give_nan_and_no_exception(case):
    x, y, expected = case
    broken = y.copy()
    broken[:: DESIGN.members, 2] = np.nan
    broken[: 49 * DESIGN.members, 3] = np.nan  # 15 base points are left
    found = analyse(DESIGN, x, broken, replicates=50)
    np.testing.assert_array_equal(found.used, [64, 64, 0, 15, 64])
    for name in INDICES:
        assert np.all(np.isnan(getattr(found, name).value[2:4]))
    assert_same(found, expected, [0, 1, 4])


def test_a_constant_output_has_no_shares(case):
    x, _, _ = case
    rounding = np.spacing(1e5) * (np.arange(DESIGN.rows) % 2)
    found = analyse(DESIGN, x, np.column_stack([np.full(DESIGN.rows, 1e5), 1e5 + rounding]), replicates=20)
    for name in ("correlation", "regression", "r2", "first", "total"):
        assert np.all(np.isnan(getattr(found, name).value))
    assert np.all(found.mu_star.value[0] == 0.0)


def test_outputs_do_not_depend_on_how_many_are_worked_on_at_a_time(case, monkeypatch):
    x, y, expected = case
    monkeypatch.setattr("vgtjax.sensitivity._indices._BLOCK", 2 * 9 * 50 * 3)  # two outputs
    assert_same(analyse(DESIGN, x, y, replicates=50), expected, slice(None))


def test_products_do_not_depend_on_how_many_points_are_added_at_a_time(case, monkeypatch):
    x, y, expected = case
    monkeypatch.setattr("vgtjax.sensitivity._moments._CHUNK", 100)
    assert_same(analyse(DESIGN, x, y, replicates=50), expected, slice(None))


def test_the_first_part_of_the_simulations_is_an_analysis_of_its_own(case):
    x, y, _ = case
    part = DESIGN.prefix(32)
    found = analyse(part, x[: part.rows], y[: part.rows], replicates=20)
    np.testing.assert_array_equal(found.used, 32)
    with pytest.raises(InputError, match=r"must have the shape \(160, columns\)"):
        analyse(part, x, y)


def test_a_plain_sample_has_linear_indices():
    sample = LatinHypercubeSample(dimensions=2, size=200, seed=0)
    x = sample.points(0, sample.rows)
    y = np.column_stack([3 * x[:, 0] + x[:, 1], x[:, 0] ** 2])
    y[5, 1] = np.nan
    found = analyse_linear(x, y, replicates=50)
    assert repr(found).startswith("correlation index of 2 outputs and 0 curves by 2 inputs")
    assert (found.outputs, found.inputs) == (("output 0", "output 1"), ("input 0", "input 1"))
    np.testing.assert_array_equal(found.used, [200, 199])
    np.testing.assert_allclose(found.correlation.value[0], np.corrcoef(x.T, y[:, 0])[2, :2] ** 2, atol=ROUNDING)
    np.testing.assert_allclose(found.r2.value[0], 1.0, atol=ROUNDING)
    kept = np.delete(np.arange(200), 5)
    expected = squared_correlation(x[kept], y[kept])[1]
    np.testing.assert_allclose(found.correlation.value[1], expected, atol=ROUNDING)
    assert np.all(found.regression.low[:, 0] < found.regression.high[:, 0])


def test_fewer_points_than_inputs_still_have_intervals():
    """Every replicate interpolates its points, in as few directions as it has points."""
    rng = np.random.default_rng(0)
    found = analyse_linear(rng.normal(size=(20, 30)), rng.normal(size=(20, 1)), replicates=50)
    for end in (found.r2.value, found.r2.low, found.r2.high):
        np.testing.assert_allclose(end, 1.0, atol=1e-6)  # the ridge over the smallest variance of a resample
    assert np.all(np.abs([found.regression.low, found.regression.high]) < 1.0)  # thirty share what one could do
    assert np.isnan(found.adjusted_r2.value)


def test_tables_that_do_not_fit_are_refused(case):
    x, y, _ = case
    with pytest.raises(InputError, match="a column for each of the 3 inputs of the design, but it has 2"):
        analyse(DESIGN, x[:, :2], y)
    with pytest.raises(InputError, match="a name for each of the 5 outputs, but there are 1; give one per column"):
        analyse(DESIGN, x, y, outputs=["y"])
    with pytest.raises(
        InputError, match="numbered outputs must stand together, but those of 'c' do not; put them side"
    ):
        analyse(DESIGN, x, y, outputs=("c[0]", "linear", "c[1]", "d", "e"))
    with pytest.raises(InputError, match="two inputs are called 'a'; give each its own name"):
        analyse_linear(x, y, inputs=["a", "b", "a"])
    with pytest.raises(InputError, match=r"same rows, but their shapes are \(320, 3\) and \(319, 5\)"):
        analyse(DESIGN, x, y[1:])
    broken = x.copy()
    broken[7, 2] = np.nan
    with pytest.raises(InputError, match="row 7, column 2 of x is nan"):
        analyse(DESIGN, broken, y)
