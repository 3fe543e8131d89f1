"""The reproduction table: complete, computed, and judged by its rules."""

import dataclasses
import functools
import html
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest
from commands import Outcome, read, run_command
from support import optimised
from thesis_examples import OF_THE_EXAMPLE
from thesis_rows import OF_THE_PRINT, polynomial_of_3_15

import vgtjax
from calibrate.output.files import MARKER
from calibrate.reproduction import MEANING, ROWS, Kind, Verdict, control_experiments
from calibrate.reproduction.identified import CONSTANTS
from calibrate.reproduction.rows import JUDGED


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
    with pytest.MonkeyPatch.context() as patch:
        # Twenty units along a minute: other rows run for less than the optimisation of their programs takes.
        patch.setattr(control_experiments, "fleet", functools.cache(optimised()(control_experiments.fleet)))
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
    assert Verdict(entry["verdict"]) in (*JUDGED[row.kind], Verdict.NOT_REPRODUCIBLE)
    assert entry["kind"] == row.kind.name.lower().replace("_", " ")
    assert entry["reason"].endswith(".")
    assert "{" not in entry["reason"]
    for field in ("section", "quantity", "where", "printed"):
        assert entry[field] == getattr(row, field) != ""


PRINTED = {
    "plunger-stiffness": 4400.0,
    "choked-ratio": 0.528,
    "line-blasius": 0.158,
    "reservoir-area": 0.90,
    "diaphragm-gain": 0.0244,
    "rise-100": 0.2,
    "fall-100": 1.2,
    "pressure-80": 0.3,
    "position-80": 0.35,
    "karnopp-held": 5.0,
    "viscous": 206.0,
    "dahl-slope": 42150.0,
    "dahl-plateau": 2.8,
    "crank-closed": 4.0,
    "vane-travel": 48.0,
    "stroke-2000": 4.0,
    "preload": 120.0,
    "stroke": 10.13,
    "src-coulomb": 0.3945,
    "table-4-2-columns": 0.3945,
    "table-4-2-range": 3.15273 - 3.12016,
    "plunger-time": 0.02,
    "identified-magnetic_force": 1.0,
    "identified-k_mem": 2000.0,
    "identified-k_s1": 2400.0,
    "identified-b_p": 22.0,
    "identified-reservoir-slope": 0.360,
    "identified-reservoir-saturation": 2.5,
    "identified-atmosphere-0": 0.02299,
    "identified-atmosphere-1": 0.168,
    "identified-atmosphere-2": 0.342,
    "identified-V_0": 60.0,
    "identified-k_sm": 12000.0,
    "identified-F_0": 49.46,
    "identified-m_d": 0.63,
    "identified-b_d": 206.0,
    "identified-dahl-F_c": 2.8,
    "identified-dahl-sigma": 42150.0,
    "identified-F_s": 3.2,
    "identified-F_c": 2.8,
    "identified-sigma_0": 43135.0,
    "identified-sigma_1": 429.77,
    "identified-sigma_2": 206.0,
    "identified-v_s": 1.0,
    "identified-stroke": 10.13,
}
"""Digits of the thesis, read from its text: sections 2.2 to 4.3, Tables 4.2, B.1 and B.2."""


@pytest.mark.parametrize("id", PRINTED)
def test_a_row_is_judged_by_what_the_thesis_prints(reproduced, id):
    (row,) = (row for row in ROWS if row.id == id)
    assert row.rule.value == pytest.approx(PRINTED[id], rel=1e-12)
    entry = reproduced.table[id]
    if id.startswith("identified-"):
        within = np.all(np.abs(np.asarray(entry["ours"]) / PRINTED[id] - 1) <= 0.1)
        # The Stribeck velocity comes out 10.5 % too low; two of the plunger's group 10.4 and 10.1 %, whose gauge these
        # signals hardly tell (a standard error is 5 %).
        assert within == (id not in ("identified-v_s", "identified-k_s1", "identified-b_p"))
        assert entry["verdict"] == ("recovered" if within else "not recovered")


def test_every_constant_that_is_identified_is_compared_with_its_print():
    assert {row.id for row in ROWS if row.id.startswith("identified-")} <= PRINTED.keys()


def test_a_row_is_of_the_kind_that_its_inputs_make_it():
    """What our identification finds again, what we close a loop around, and what traces of ours show is no result."""
    kinds = {row.id: row.kind for row in ROWS}
    of_section = {row.id: row.section.split()[0] for row in ROWS}
    for id, kind in kinds.items():
        assert (kind is Kind.RECOVERY) == id.startswith(("identified-", "dahl-")), id
        if id.startswith(("static-", "example-")) or id.endswith("-divided") or of_section[id] == "5.3-5.4":
            assert kind is Kind.OWN_INPUTS, id


def test_every_row_of_a_closed_loop_says_what_its_controller_knew(reproduced):
    loops = [entry for entry in reproduced.table.values() if entry["section"].startswith("5.3-5.4")]
    assert len(loops) == 17
    for entry in loops:
        knew = (
            "knows its plant exactly",
            "measures the chamber pressure",
            "not the vane force",
            "knows the printed actuator",
        )
        assert any(words in entry["reason"] for words in knew), entry["id"]


def test_the_manual_counts_the_verdicts(reproduced):
    said = (pathlib.Path(__file__).parents[3] / "docs" / "thesis.md").read_text(encoding="utf-8")
    verdicts = [entry["verdict"] for entry in reproduced.table.values()]
    counts = [(verdict, verdicts.count(verdict)) for verdict in MEANING]
    assert "\n" + "".join(f"{count:4} {verdict}\n" for verdict, count in counts) in reproduced.outcome.out
    rows = [f"| {verdict} | {count} | {MEANING[verdict]} |" for verdict, count in counts]
    assert "| verdict | rows | what it says |\n|---|---|---|\n" + "\n".join(rows) + "\n\n" in said


def test_ids_are_unique_and_sections_stay_together():
    assert len({row.id for row in ROWS}) == len(ROWS)
    sections = [row.section for row in ROWS]
    assert sections == sorted(sections)
    assert all(section[0] in "2345B" for section in sections)


GAMMA = 1.396
CRITICAL = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))
OUTSIDE = np.sqrt(CRITICAL ** (2 / GAMMA) - CRITICAL ** ((GAMMA + 1) / GAMMA)) * 2 / (GAMMA - 1)
"""Phi of (2.15) where flow chokes, with `2/(gamma-1)` outside the root as printed."""
FAST, SLOW = (-np.roots([0.63, 206.0, 12_000.0]).real).tolist()
"""Rates in 1/s of (4.4)."""

COLD = polynomial_of_3_15(np.linspace(4.0, 36.0, 65), 1.0)


KNOWN = [
    # By hand, with Tables B.1 and B.2 and the equation named.
    ("coil-force", "identity", 1.0),
    ("force-last-digit", "differs", 0.5e-4 * 100**2 / 1.7425e-4 / 100),  # half a digit over the area, mbar
    ("plunger-stiffness", "differs", 2000.0),
    ("choked-ratio", "differs", CRITICAL),
    ("phi-as-printed", "differs", 100 * (OUTSIDE / (2 / (GAMMA + 1)) ** ((GAMMA + 1) / (GAMMA - 1) / 2) - 1)),
    (
        "phi-as-printed-in-the-whole",
        "differs",
        100 * (OUTSIDE / (2 / (GAMMA + 1)) ** ((GAMMA + 1) / (GAMMA - 1) / 4) - 1),
    ),
    ("sonic-throat", "identity", 1.0),
    ("line-blasius", "identity", 0.316 / 2),
    ("line-delay", "not reproducible", 1e3 * 0.5 / np.sqrt(GAMMA * 286.7 * 293.15)),
    ("reservoir-area", "identity", 1e6 * 0.360e-3 * 2.5e-3),
    ("closed-at-rest", "differs", 1e6 * (2.299e-8 + 1.68e-4 * 2e-6)),
    ("pressure-gain", "differs", GAMMA),
    ("flow-sign", "differs", -1.0),
    ("diaphragm-gain", "differs", -2.9224e-3 / 12_000 * 1e3 * 100),  # mm/mbar
    ("karnopp-held", "differs", 3.2),
    ("stribeck-range", "identity", [2.8, 3.2]),
    ("viscous", "input", 206.0),
    ("dahl-slope", "recovered", 42_150.0),
    ("dahl-plateau", "recovered", 2.8),
    ("crank-closed", "input", 4.0),
    ("vane-travel", "differs", 3.12 * 10.13),
    ("stroke-2000", "differs", (32 - 16) / 3.12),
    ("polynomial-cold", "differs", [COLD.min(), COLD.max()]),
    ("polynomial-severe", "differs", polynomial_of_3_15(4.0, 1 + 3e5 / 101_013)),
    ("polynomial-largest", "differs", [36.0, 36.0, 36.0]),
    ("preload", "differs", 49.46 / 2.9224e-3 / 1e3),
    ("spring-sign", "differs", np.roots([0.63, 206.0, -12_000.0]).max()),
    ("step-start", "differs", 1 + (1 / SLOW + 1 / FAST) / (1 / SLOW - 1 / FAST)),
    # Closed forms and an independent plant, computed elsewhere.
    ("phi-corrected", "identity", 0.0),
    ("pressure-80", "differs", 0.195),
    ("position-80", "differs", 0.284),
    ("pressure-80-divided", "met with our inputs", 0.27),
    ("position-80-divided", "met with our inputs", 0.39),
    # NumPy alone: the printed columns; exp(-5) of the Stribeck curve; numerical derivatives of (4.4), corrected.
    ("table-4-2-columns", "differs", 0.0041578),
    ("table-4-2-range", "differs", 1 - np.exp(-5)),
    ("src-coulomb", "differs", 0.93176),
    ("src-together", "missed with our inputs", [0.250, 0.0854]),
    ("settled-leading", "identity", [0.0, 0.5]),
    ("friction-leading", "missed with our inputs", [0.12061, 5.285e-5]),
]
"""Rows with their verdicts."""


@pytest.mark.parametrize(("id", "verdict", "ours"), KNOWN)
def test_known_rows(reproduced, id, verdict, ours):
    entry = reproduced.table[id]
    assert entry["verdict"] == verdict
    assert entry["ours"] == pytest.approx(ours, rel=0.015, abs=1e-6)


LOOPS = ["loop-pi", "loop-friction-observer", "loop-backstepping-peak", "loop-backstepping-rms", "loop-response"]
LOOPS += ["loop-observed-pressure", "loop-adaptive", "fleet-adaptive-peak", "loop-load-learned"]
MISSED = ["loop-knocker", "loop-overshoot", "fleet-backstepping-peak", "fleet-observed-pressure"]
MISSED += ["fleet-load-learned-peak", "fleet-load-learned-pressure"]


@pytest.mark.parametrize("loop", LOOPS)
def test_closed_loops_with_gains_of_ours_are_as_good_as_the_thesis_reports(reproduced, loop):
    entry = reproduced.table[loop]
    assert entry["verdict"] == "met with our inputs"
    # One value for each turbine pressure, none of them like another: they are runs of their own.
    assert len(set(entry["ours"])) == len(entry["ours"]) == 3


@pytest.mark.parametrize("loop", MISSED)
def test_what_the_print_or_a_strangers_plant_does_not_give_is_said(reproduced, loop):
    """Pulses as weak as printed, a jump that saturates the duty, and a design model that is not the plant's."""
    assert reproduced.table[loop]["verdict"] == "missed with our inputs"
    assert max(reproduced.table["loop-overshoot"]["ours"]) < 0.2  # 0.19 mm


DERIVED = OF_THE_PRINT | OF_THE_EXAMPLE


@pytest.mark.parametrize("id", DERIVED)
def test_a_row_is_what_is_derived_once_more(reproduced, id):
    """After the command has run: some need the fit that it has made."""
    derived = DERIVED[id]
    expected = np.asarray(derived.value(), dtype=float).tolist()
    tolerances = [np.broadcast_to(each, np.shape(expected)) for each in (derived.rel, derived.abs)]
    allowed = np.maximum(tolerances[0] * np.abs(expected), tolerances[1])
    np.testing.assert_array_less(np.abs(np.subtract(reproduced.table[id]["ours"], expected)), allowed + 1e-15)


FROZEN = {"loop-observed-pressure-step": (1613.0, 2120.0, 2407.0), "fleet-adaptive-rms": (0.00471, 0.00532, 0.00607)}
"""Our own output, as nothing else was at hand: closed loops of which the thesis prints neither gains nor sensors, whose
controller and observer would have to be written once more. A change of either is to be seen here."""


@pytest.mark.parametrize("id", FROZEN)
def test_what_only_our_own_loops_say_stays_as_it_is(reproduced, id):
    # Peaks move by some percents with the noise of the sensors.
    assert reproduced.table[id]["ours"] == pytest.approx(FROZEN[id], rel=0.05)


def test_every_row_is_compared_with_a_number():
    """Of closed loops that is the thesis's bound; a few rows have tests of their own beside the table."""
    elsewhere = {"flow-map-equilibrium", "plunger-time"}  # test_reproduction_reduced.py
    elsewhere |= {"engine-clearance", "engine-displacement"}  # test_gas_flow.py
    identified = {id for id in PRINTED if id.startswith("identified-")}
    numbers = {id for id, _, _ in KNOWN} | DERIVED.keys() | FROZEN.keys() | identified
    assert numbers | {*LOOPS, *MISSED} | elsewhere == {row.id for row in ROWS}


def test_printed_constants_are_those_of_the_model(actuator):
    for constant in CONSTANTS:
        entries = np.ravel(vgtjax.get_parameter(actuator, constant.name))
        assert constant.scale * entries[constant.index] == pytest.approx(constant.value, rel=1e-12)


def test_importing_computes_nothing():
    code = "import calibrate.reproduction, vgtjax; vgtjax.configure()"  # which JAX refuses once it has computed
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_slow_rows_can_be_left_out():
    assert {row.id for row in ROWS if row.slow} == {
        row.id for row in ROWS if row.id.startswith(("identified-", "static-", "example-", "fleet-"))
    }


def test_the_report_shows_every_row_and_loads_nothing(reproduced):
    page = (reproduced.out / "report.html").read_text(encoding="utf-8")
    cells = re.findall(r"<td[^>]*>(.*?)(?:<br>|</td>)", page)
    for entry in reproduced.table.values():
        assert entry["quantity"] in map(html.unescape, cells)
        assert entry["reason"] in map(html.unescape, cells)
    assert not re.search(r"<(link|iframe|img|object|embed|base)\b|<script[^>]+src=", page)
    assert page.count("drawFigure(") >= 3


def test_a_second_run_does_nothing(reproduced):
    before = contents(reproduced.out)
    outcome = run_command("reproduce", "--out", reproduced.out)
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith(f"nothing to do: {reproduced.out} holds the results already\n")
    assert contents(reproduced.out) == before


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    outcome = run_command("reproduce", "--out", tmp_path)
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err == f"error: {tmp_path} is not empty and no study wrote it; choose another --out\n"

    fitted = tmp_path / "fitted"
    fitted.mkdir()
    (fitted / MARKER).write_text('{"command": "fit", "fingerprint": "0123"}')
    (fitted / "parameters.json").write_text("{}")
    before = contents(fitted)
    outcome = run_command("reproduce", "--out", fitted)
    assert outcome.status == 2
    assert "holds the results of another study ('fit', other inputs)" in outcome.err
    assert contents(fitted) == before


def test_a_study_is_not_taken(tmp_path):
    outcome = run_command("reproduce", "study.toml", "--out", tmp_path / "out")
    assert outcome.status == 2
    assert "unexpected extra argument (study.toml)" in outcome.err
