"""The reproduction table: complete, computed, and judged by its rules."""

import dataclasses
import html
import math
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest
from commands import Outcome, read, run_command

import vgtjax
from calibrate.output.files import MARKER
from calibrate.reproduction import ROWS, Found, Row
from calibrate.reproduction.identified import CONSTANTS
from calibrate.reproduction.rows import Between, Near, Rising

VERDICTS = {"reproduced", "differs", "not reproducible"}


@dataclasses.dataclass(frozen=True)
class Reproduced:
    """What the command wrote and said."""

    out: pathlib.Path
    outcome: Outcome

    @property
    def table(self):
        return {entry["id"]: entry for entry in read(self.out / "reproduction.json")}


def contents(folder):
    return {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.iterdir()}


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "out"
    return Reproduced(out, run_command("reproduce", "--out", out))


def test_the_command_writes_table_and_report(reproduced):
    assert (reproduced.outcome.status, reproduced.outcome.err) == (0, "")
    assert {path.name for path in reproduced.out.iterdir()} == {MARKER, "reproduction.json", "report.html"}
    assert reproduced.outcome.out.endswith(f"report: {(reproduced.out / 'report.html').resolve()}\n")


def test_every_statement_has_its_row(reproduced):
    assert list(reproduced.table) == [row.id for row in ROWS]
    assert len(reproduced.table) == len(ROWS) > 50


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.id)
def test_every_row_has_a_value_a_verdict_and_a_reason(reproduced, row):
    entry = reproduced.table[row.id]
    assert np.all(np.isfinite(entry["ours"]))
    assert entry["verdict"] in VERDICTS
    assert entry["reason"].endswith(".")
    assert "{" not in entry["reason"]
    for field in ("section", "quantity", "where", "printed"):
        assert entry[field] == getattr(row, field) != ""


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.id)
def test_the_verdict_follows_from_the_numbers(reproduced, row):
    entry = reproduced.table[row.id]
    ours = entry["ours"] if isinstance(entry["ours"], float) else tuple(np.atleast_1d(entry["ours"]))
    if row.missing:
        assert entry["verdict"] == "not reproducible"
        assert entry["reason"].startswith(f"The thesis does not print {row.missing}.")
    else:
        assert entry["verdict"] == ("reproduced" if row.rule.met(ours) else "differs")
        assert entry["rule"] == str(row.rule)


def row_with(rule, ours, missing=""):
    return Row("a", "2", "b", "(1)", "3 s", "s", rule, lambda: ours, "It is {ours} s.", missing)


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
        "a", "2", "b", "(1)", "3 s", "s", Near(3, 1), lambda: Found(2.0, {"f": 7}), "{ours} s, {f} mm."
    ).evaluate()
    assert (result.reason, result.text) == ("2 s, 7 mm.", "2 s")


def test_ids_are_unique_and_sections_stay_together():
    assert len({row.id for row in ROWS}) == len(ROWS)
    sections = [row.section for row in ROWS]
    assert sections == sorted(sections)
    assert all(section[0] in "2345" for section in sections)


@pytest.mark.parametrize(
    ("id", "verdict", "ours"),
    [
        # Closed forms and an independent plant, computed elsewhere.
        ("choked-ratio", "differs", 0.52896),
        ("phi-corrected", "reproduced", 0.0),
        ("pressure-80", "differs", 0.195),
        ("position-80", "differs", 0.284),
        ("pressure-80-divided", "reproduced", 0.27),
        ("position-80-divided", "reproduced", 0.39),
        ("preload", "differs", 16.92),
        ("vane-travel", "differs", 31.6),
        ("stroke-2000", "differs", 5.13),
        ("force-last-digit", "differs", 29.0),
        # NumPy alone: the printed columns; exp(-5) of the Stribeck curve; numerical derivatives of (4.4), corrected.
        ("table-4-2-columns", "differs", 0.0041578),
        ("table-4-2-range", "differs", 1 - np.exp(-5)),
        ("src-coulomb", "differs", 0.93176),
        ("src-together", "differs", [0.250, 0.0854]),
        ("settled-leading", "reproduced", [0.0, 0.5]),
        ("friction-leading", "differs", [0.12061, 5.285e-5]),
    ],
)
def test_known_rows(reproduced, id, verdict, ours):
    entry = reproduced.table[id]
    assert entry["verdict"] == verdict
    assert entry["ours"] == pytest.approx(ours, rel=0.015, abs=1e-6)


LOOPS = ["loop-pi", "loop-knocker", "loop-friction-observer", "loop-backstepping-peak", "loop-backstepping-rms"]
LOOPS += ["loop-observed-pressure", "loop-response", "loop-overshoot", "loop-adaptive", "fleet-adaptive-peak"]


@pytest.mark.parametrize("loop", LOOPS)
def test_closed_loops_are_as_good_as_the_thesis_reports(reproduced, loop):
    entry = reproduced.table[loop]
    assert entry["verdict"] == "reproduced"
    # One value for each turbine pressure, none of them like another: they are runs of their own.
    assert len(set(entry["ours"])) == len(entry["ours"]) == 3


def test_printed_constants_are_those_of_the_model(actuator):
    for constant in CONSTANTS:
        entries = np.ravel(vgtjax.get_parameter(actuator, constant.name))
        assert constant.scale * entries[constant.index] == pytest.approx(constant.value, rel=1e-12)


def test_importing_computes_nothing():
    code = "import calibrate.reproduction, vgtjax; vgtjax.configure()"  # which JAX refuses once it has computed
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_slow_rows_can_be_left_out():
    assert {row.id for row in ROWS if row.slow} == {
        row.id for row in ROWS if row.id.startswith(("identified-", "static-", "bench-", "fleet-"))
    }


def test_the_report_shows_every_row_and_loads_nothing(reproduced):
    page = (reproduced.out / "report.html").read_text(encoding="utf-8")
    cells = re.findall(r"<td[^>]*>(.*?)(?:<br>|</td>)", page)
    for entry in reproduced.table.values():
        assert entry["quantity"] in map(html.unescape, cells)
        assert entry["reason"] in map(html.unescape, cells)
    assert not re.search(r"<(link|iframe|img|object|embed|base)\b|<script[^>]+src=", page)
    assert page.count("Plotly.newPlot(") >= 3


def test_a_second_run_does_nothing(reproduced):
    before = contents(reproduced.out)
    outcome = run_command("reproduce", "--out", reproduced.out)
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith(f"nothing to do: {reproduced.out} holds the results already\n")
    assert contents(reproduced.out) == before


def test_a_folder_of_something_else_is_refused(reproduced, fitted, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    outcome = run_command("reproduce", "--out", tmp_path)
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err == f"error: {tmp_path} is not empty and no study wrote it; choose another --out\n"

    before = contents(fitted.out)
    outcome = run_command("reproduce", "--out", fitted.out)
    assert outcome.status == 2
    assert "holds the results of another study ('fit', other inputs)" in outcome.err
    assert contents(fitted.out) == before


def test_a_study_is_not_taken(tmp_path):
    outcome = run_command("reproduce", "study.toml", "--out", tmp_path / "out")
    assert outcome.status == 2
    assert "unexpected extra argument (study.toml)" in outcome.err
