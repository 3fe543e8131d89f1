"""A row of the reproduction table: its rule, its verdict, its reason."""

import math

import pytest

from calibrate.reproduction import MEANING, Found, Kind, Row, Verdict
from calibrate.reproduction.rows import JUDGED, Between, Near, Rising


def test_only_a_result_of_the_thesis_can_be_reproduced():
    assert JUDGED.keys() == set(Kind)
    assert [kind for kind, verdicts in JUDGED.items() if Verdict.REPRODUCED in verdicts] == [Kind.RESULT]
    assert MEANING.keys() == set(Verdict)


def row_with(rule, ours, missing="", kind=Kind.RESULT):
    return Row("a", kind, "2", "b", "(1)", "3 s", "s", rule, lambda: ours, "It is {ours} s.", missing)


@pytest.mark.parametrize(
    ("rule", "ours", "verdict"),
    [
        (Near(3.0, 0.5), 3.5, "reproduced"),
        (Near(3.0, 0.5), 3.6, "differs"),
        (Near(3.0, 0.5), Found((2.6, 3.4)), "reproduced"),
        (Near(3.0, 0.5), Found((2.4, 3.4)), "differs"),
        (Near(3.0, 0.5), math.nan, "differs"),
        (Between(1.0, 2.0), 2.0, "reproduced"),
        (Between(1.0, 2.0), 2.1, "differs"),
        (Between(1.0, math.inf), 0.9, "differs"),
        (Rising(), Found((1.0, 2.0, 3.0)), "reproduced"),
        (Rising(), Found((1.0, 3.0, 3.0)), "differs"),
        (Rising(1.5), Found((1.0, 2.0)), "differs"),
    ],
)
def test_rules(rule, ours, verdict):
    assert row_with(rule, ours).evaluate().verdict == verdict


@pytest.mark.parametrize(
    ("kind", "met", "missed"),
    [
        (Kind.RESULT, "reproduced", "differs"),
        (Kind.INPUT, "input", "differs"),
        (Kind.IDENTITY, "identity", "differs"),
        (Kind.RECOVERY, "recovered", "not recovered"),
        (Kind.OWN_INPUTS, "met with our inputs", "missed with our inputs"),
    ],
)
def test_a_verdict_is_of_the_kind_of_its_row(kind, met, missed):
    assert row_with(Near(3.0, 0.5), 3.0, kind=kind).evaluate().verdict == met
    assert row_with(Near(3.0, 0.5), 4.0, kind=kind).evaluate().verdict == missed
    assert row_with(Near(3.0, 0.5), 3.0, "the length", kind).evaluate().verdict == "not reproducible"


def test_what_is_not_printed_can_not_be_reproduced():
    result = row_with(Near(3.0, 0.5), 3.0, missing="the length").evaluate()
    assert (result.verdict, result.reason) == (
        "not reproducible",
        "The thesis does not print the length. It is 3 s.",
    )


def test_a_row_needs_a_rule_or_says_what_is_missing():
    with pytest.raises(ValueError, match="a: a row needs a rule, or must say what the print is missing"):
        row_with(None, 3.0)


def test_reasons_name_computed_numbers():
    result = Row(
        "a", Kind.RESULT, "2", "b", "(1)", "3 s", "s", Near(3, 1), lambda: Found(2.0, {"f": 7}), "{ours} s, {f} mm."
    ).evaluate()
    assert (result.reason, result.text) == ("2 s, 7 mm.", "2 s")
