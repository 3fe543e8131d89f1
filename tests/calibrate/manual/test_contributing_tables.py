"""What the site makes of CONTRIBUTING's tables."""

import re

import pytest
from markdown_pages import ROOT

pytest.importorskip("griffe", reason="the extra docs is not installed")

from calibrate.manual.contributing import equations, errata, numbers_in
from calibrate.manual.equations import index, other_errata
from calibrate.manual.reference import as_table

BRACKETS = re.compile(
    r"\[((?:[A-C2-5]\.[1-9]\d?(?:-(?:[A-C2-5]\.)?\d+)?(?:, )?)+)(?:,? ?(?:errat\w+|corrected)[^\]]*)?\]"
)
"""Numbers as docstrings have them, e.g. [2.13-2.15, A.29] or [3.16, erratum]."""


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("2.7", ["2.7"]),
        ("2.13-2.15, A.29", ["2.13", "2.14", "2.15", "A.29"]),
        ("5.34, 5.47 for unknown plants", ["5.34", "5.47"]),
        ("section 4.2", []),
        ("section 3.3.2.2", []),
        ("Table 4.2: SRC", []),
        ("B.2.1", []),
        ("after 5.35", ["5.35"]),
    ],
)
def test_numbers_are_taken_apart(text, numbers):
    assert numbers_in(text) == numbers


def test_every_number_that_a_docstring_names_is_in_the_index():
    listed = {number for row in equations() for number in row.numbers}
    named = {}
    for path in [*(ROOT / "vgtjax").rglob("*.py"), *(ROOT / "calibrate").rglob("*.py")]:
        for found in BRACKETS.findall(path.read_text(encoding="utf-8")):
            named |= dict.fromkeys(numbers_in(found), path.name)
    assert len(named) > 150
    assert {number: path for number, path in named.items() if number not in listed} == {}


def test_no_erratum_is_lost():
    shown = index() + other_errata()
    assert [erratum.mistake for erratum in errata() if f"Erratum {erratum.mistake}." not in shown] == []


def test_an_erratum_stands_with_its_equation():
    (row,) = [row for row in equations() if row.what == "flow function"]
    assert [erratum.mistake for erratum in row.errata] == ["2.15: `2/(gamma-1)` belongs under the root"]


def test_a_bar_in_a_cell_is_no_border():
    assert as_table(("a",), [("x|y",)]) == "| a |\n| --- |\n| x\\|y |"
