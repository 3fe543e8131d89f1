"""Verdicts on indices that agree and disagree, by rule and on functions made to mislead."""

import numpy as np
import pytest
from sensitivity_systems import Ishigami

from vgtjax import InputError
from vgtjax.sensitivity import (
    Interval,
    RadialDesign,
    RankedInput,
    Verdict,
    analyse,
    explain,
    gradient_share,
    rank_inputs,
)
from vgtjax.sensitivity._ranking import judge

LOW, AT, HIGH = Interval(0.01, 0.0, 0.03), Interval(0.05, 0.02, 0.08), Interval(0.4, 0.35, 0.45)
UNKNOWN = Interval(np.nan, np.nan, np.nan)
HUGE = Interval(0.95, 0.91, 1.0)
WIDE = Interval(0.15, 0.02, 0.3)


@pytest.mark.parametrize(
    ("correlation", "regression", "first", "total", "local", "verdicts"),
    [
        (HIGH, HIGH, HIGH, HIGH, HIGH, [Verdict.AGREE]),
        (LOW, LOW, LOW, LOW, LOW, [Verdict.AGREE]),
        (AT, AT, WIDE, HIGH, AT, [Verdict.AGREE]),  # who is uncertain contradicts nobody
        (AT, AT, AT, LOW, AT, [Verdict.AGREE]),
        (HIGH, HIGH, HIGH, HIGH, UNKNOWN, [Verdict.AGREE]),
        (UNKNOWN, UNKNOWN, LOW, LOW, LOW, [Verdict.AGREE]),
        (HIGH, LOW, LOW, AT, HIGH, [Verdict.UNCERTAIN]),
        (HIGH, HIGH, HIGH, UNKNOWN, HIGH, [Verdict.NO_INDEX]),
        (LOW, LOW, HIGH, HIGH, HIGH, [Verdict.NOT_LINEAR]),
        (LOW, HIGH, HIGH, HIGH, HIGH, [Verdict.NOT_LINEAR]),
        (HIGH, LOW, HIGH, HIGH, HIGH, [Verdict.NOT_LINEAR]),
        (LOW, LOW, LOW, HIGH, HIGH, [Verdict.ONLY_TOGETHER]),
        (LOW, LOW, LOW, HIGH, LOW, [Verdict.ONLY_TOGETHER, Verdict.GRADIENT_MISLEADS]),
        (HIGH, HIGH, HIGH, HUGE, HIGH, [Verdict.MOSTLY_TOGETHER]),
        (AT, AT, AT, HIGH, HIGH, [Verdict.MOSTLY_TOGETHER]),
        (LOW, LOW, HIGH, HUGE, LOW, [Verdict.MOSTLY_TOGETHER, Verdict.NOT_LINEAR, Verdict.GRADIENT_MISLEADS]),
        (HIGH, HIGH, HIGH, HIGH, LOW, [Verdict.GRADIENT_MISLEADS]),
        (LOW, LOW, LOW, LOW, HIGH, [Verdict.GRADIENT_MISLEADS]),
        (HIGH, LOW, LOW, LOW, LOW, [Verdict.OVERSTATED]),
        (LOW, HIGH, LOW, LOW, LOW, [Verdict.OVERSTATED]),
        (LOW, LOW, HIGH, LOW, HIGH, [Verdict.OVERSTATED, Verdict.GRADIENT_MISLEADS]),
    ],
)
def test_verdicts_follow_the_rules(correlation, regression, first, total, local, verdicts):
    assert judge(correlation, regression, first, total, local) == tuple(verdicts)


def test_the_threshold_is_the_callers():
    assert judge(LOW, LOW, LOW, HIGH, HIGH, threshold=0.5) == (Verdict.AGREE,)
    assert judge(LOW, LOW, LOW, HIGH, HIGH, threshold=0.4) == (Verdict.UNCERTAIN,)


@pytest.fixture(scope="module")
def ishigami():
    """Ishigami's function and a constant, with the gradient at the middle as the local view."""
    function = Ishigami()
    design = RadialDesign(3, 2048, 1)
    x = function.inputs(design.points(0, design.rows))
    y = np.column_stack([function(x), np.ones(design.rows)])
    nominal = function.gradients(np.full((1, 3), 1e-6))
    local = np.vstack([gradient_share(nominal, np.full(3, np.pi / np.sqrt(3))), np.full((1, 3), np.nan)])
    return analyse(design, x, y, inputs=("x1", "x2", "x3"), outputs=("y", "one")), local


def test_ishigami_is_ranked_and_explained(ishigami):
    indices, local = ishigami
    ranking, constant = rank_inputs(indices, local=local).outputs
    assert ranking.output == "y"
    assert ranking.used == 2048
    assert [entry.name for entry in ranking.inputs] == ["x1", "x2", "x3"]  # total indices of 0.56, 0.44, 0.24
    first, second, third = ranking.inputs
    assert first.verdicts == (Verdict.AGREE,)
    assert second.verdicts == (Verdict.NOT_LINEAR, Verdict.GRADIENT_MISLEADS)
    assert third.verdicts == (Verdict.ONLY_TOGETHER, Verdict.GRADIENT_MISLEADS)
    assert explain(first, ranking.r2) == "all agree"
    assert explain(second, ranking.r2) == (
        f"linear indices miss it (R2 = {ranking.r2:.2f}); the gradient at the nominal misleads "
        f"({second.local.value:.2g} instead of {second.total.value:.2g})"
    )
    assert explain(third, ranking.r2).startswith("matters only together with others (total 0.24, first order ")
    assert [entry.verdicts for entry in constant.inputs] == [(Verdict.NO_INDEX,)] * 3
    assert [entry.name for entry in constant.inputs] == ["x1", "x2", "x3"]


def test_every_verdict_can_be_explained():
    for verdict in Verdict:
        indices = dict.fromkeys(("correlation", "regression", "first", "total", "local", "mu_star"), HIGH)
        text = explain(RankedInput("x", **indices, verdicts=(verdict,)), 0.5)
        assert text.startswith(verdict.value)


def test_the_squared_coefficient_has_the_interval_of_the_square(ishigami):
    indices, _ = ishigami
    ranking = rank_inputs(indices)["y"]
    certain, uncertain = ranking["x1"].regression, ranking["x2"].regression
    ends = indices.regression.low[0], indices.regression.high[0]
    assert ends[0][0] > 0
    assert certain == Interval(indices.regression.value[0, 0] ** 2, ends[0][0] ** 2, ends[1][0] ** 2)
    assert ends[0][1] < 0 < ends[1][1]
    assert uncertain.low == 0.0
    assert uncertain.high == max(ends[0][1] ** 2, ends[1][1] ** 2)
    assert all(np.isnan(entry.local.value) for entry in ranking.inputs)


def test_rankings_are_read_by_name(ishigami):
    indices, local = ishigami
    found = rank_inputs(indices, ["a", "b", "c"], ["first", "second"], local=local)
    assert list(found) == ["first", "second"]
    assert "second" in found
    assert "y" not in found
    assert list(found["first"]) == ["a", "b", "c"]
    assert "c" in found["first"]
    assert "x3" not in found["first"]
    assert found["first"]["c"].total == Interval(*(end[0, 2] for end in ends(indices.total)))
    assert found["first"]["b"].local.value == local[0, 1]
    with pytest.raises(InputError, match="output 'frist' matches nothing; did you mean 'first'"):
        found["frist"]
    with pytest.raises(InputError, match="input 'd' matches nothing"):
        found["first"]["d"]


def ends(estimate):
    return estimate.value, estimate.low, estimate.high


def test_rankings_print_themselves(ishigami):
    indices, local = ishigami
    found = rank_inputs(indices, local=local)
    totals, r2 = indices.total.value[0], indices.r2.value[0]
    title, head, of_y, of_one = repr(found).splitlines()
    assert title == "2 outputs, with the inputs of the largest total indices"
    assert head.split() == ["output", "points", "R2", "largest", "second", "third"]
    largest = [word for name, total in zip(("x1", "x2", "x3"), totals, strict=True) for word in (name, f"{total:.2f}")]
    assert of_y.split() == ["y", "2048", f"{r2:.2f}", *largest]
    assert of_one.split() == ["one", "2048"]  # what does not vary has no shares
    title, head, *rows, second, third = repr(found["y"]).splitlines()
    assert title == f"y: 2048 points, R2 {r2:.2f}"
    assert head.split()[:6] == ["input", "correlation", "regression", "first", "total", "local"]
    for number, row in enumerate(rows):
        regression = indices.regression.value[0, number] ** 2
        shares = (indices.correlation.value, regression, indices.first.value, indices.total.value, local)
        shown = [float(np.atleast_2d(each)[0, number if np.ndim(each) else 0]) for each in shares]
        shown += [indices.total.low[0, number], indices.total.high[0, number]]
        assert row.split() == [f"x{number + 1}", *(f"{share:.2f}" for share in shown)]
    assert second.startswith("x2: linear indices miss it")
    assert third.startswith("x3: matters only together")
    assert "<td>x1</td>" in found["y"]._repr_html_()


def test_names_that_do_not_fit_are_refused(ishigami):
    indices, local = ishigami
    with pytest.raises(InputError, match=r"names must be for 2 outputs and 3 inputs, but they are for \(2, 2\)"):
        rank_inputs(indices, ["x1", "x2"], ["y", "one"])
    with pytest.raises(InputError, match=r"local shares must be for 2 outputs and 3 inputs, but they are for \(1, 3\)"):
        rank_inputs(indices, ["x1", "x2", "x3"], ["y", "one"], local=local[:1])
