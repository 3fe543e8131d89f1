"""Several actuators in one study: a folder each, and the whole on top."""

import json

import numpy as np
import pytest
from commands import cut_example, entries_of, read, run_command, timeless
from pages import Page

import calibrate.fit.command

STUDY = """
[[trace]]
file = "unit_0*_a.csv"
unit = "{stem:7}"
name = "{stem}"

[[trace]]
file = "unit_0*_b.csv"
unit = "{stem:7}"
use = "validate"

[fit]
free = ["converter.magnetic_force[2]", "diaphragm.preload", "diaphragm.stiffness", "friction.viscous_damping"]

[parameters]
"diaphragm.stiffness" = {lower = 8000, upper = 16000}
"""
FILES = {"parameters.json", "summary.json", "report.html"}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two units of the same trace; the first has another one to validate on."""
    folder = tmp_path_factory.mktemp("fleet")
    for new_name, name in (("unit_01_a", "step_80"), ("unit_01_b", "step_50"), ("unit_02_a", "step_80")):
        cut_example(name, 1.2, folder, new_name)
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def fleet(study):
    """The folder of a fit of both units, and what the user saw."""
    out = study.parent / "out"
    return out, run_command("fit", study, "--out", out)


def test_every_unit_has_its_folder_and_the_whole_is_on_top(fleet):
    out, outcome = fleet
    assert (outcome.status, outcome.err) == (0, "")
    assert {path.name for path in out.iterdir()} == {".study.json", "summary.json", "report.html", "unit_01", "unit_02"}
    for unit in ("unit_01", "unit_02"):
        assert {path.name for path in (out / unit).iterdir()} == FILES


def test_what_errors_take_for_exact_is_said_once_for_all_units(fleet):
    out, outcome = fleet
    (said,) = [line for line in outcome.out.splitlines() if "for exact" in line]
    for unit in ("unit_01", "unit_02"):
        (found,) = [each for each in read(out / unit / "summary.json")["found"] if "for exact" in each]
        assert said == f"note: {found}"


def test_reports_can_be_made_again_but_for_date_and_time(fleet, study):
    out, again = fleet[0], study.parent / "again"
    assert run_command("fit", study, "--out", again).status == 0
    for place in (".", "unit_01", "unit_02"):
        assert timeless(out / place / "report.html") == timeless(again / place / "report.html")


def test_the_report_of_the_whole_shows_the_summaries(fleet):
    out, _ = fleet
    units, page = read(out / "summary.json")["units"], Page((out / "report.html").read_text(encoding="utf-8"))
    rows = page.table("unit", "verdict")
    assert [row["unit"] for row in rows] == list(units)
    for row, said in zip(rows, units.values(), strict=True):
        worst = {name: max(trace["rmse"][name] for trace in said["traces"].values()) for name in ("x_d", "p_act")}
        assert row["verdict"] == "converged"
        assert (row["steps"], row["seconds"]) == (str(said["iterations"]), f"{said['wall_seconds']:.3g}")
        assert row["chi²/dof"] == f"{said['chi2_per_degree_of_freedom']:.4g}"
        assert (row["x_d RMSE, um"], row["p_act RMSE, Pa"]) == (f"{1e6 * worst['x_d']:.3g}", f"{worst['p_act']:.3g}")
    found = [entries_of(read(out / unit / "parameters.json")["parameters"]) for unit in units]
    differ = page.table("name", "mean")
    assert [row["name"] for row in differ] == [name for name, fields in found[0].items() if fields["free"]]
    for row in differ:
        values, errors = ([fields[row["name"]][key] for fields in found] for key in ("value", "std_error"))
        assert row == {
            "name": row["name"],
            "mean": f"{np.mean(values):.5g}",
            "deviation": f"{np.std(values, ddof=1):.3g}",
            "standard error": f"{np.median(errors):.2g}",
            "lowest": f"{min(values):.5g}",
            "highest": f"{max(values):.5g}",
            "unit": found[0][row["name"]]["unit"],
        }


def test_the_summary_of_the_whole_is_keyed_by_units(fleet):
    out, _ = fleet
    whole = read(out / "summary.json")
    assert whole == {"units": {unit: read(out / unit / "summary.json") for unit in ("unit_01", "unit_02")}}
    assert set(whole["units"]["unit_01"]["traces"]) == {"unit_01_a", "unit_01_b"}
    assert set(whole["units"]["unit_02"]["traces"]) == {"unit_02_a"}


def test_the_report_of_the_whole_has_both_units(fleet):
    out, _ = fleet
    whole = (out / "report.html").read_text(encoding="utf-8")
    for unit in ("unit_01", "unit_02"):
        assert f'<a href="{unit}/report.html">' in whole
    assert "unit_02" not in (out / "unit_01" / "report.html").read_text(encoding="utf-8").partition("To repeat")[0]


def test_a_unit_is_fitted_as_if_alone(fleet, fitted):
    out, _ = fleet
    alone, among = read(fitted.out / "parameters.json"), read(out / "unit_02" / "parameters.json")
    assert among["parameters"].keys() == alone["parameters"].keys()
    for name, fields in among["parameters"].items():
        if fields["free"] is True:
            # The same trace from another start: both stop within a small part of a standard error of the minimum.
            assert fields["value"] == pytest.approx(alone["parameters"][name]["value"], abs=0.1 * fields["std_error"])


def test_in_processes_of_their_own_units_come_out_the_same(fleet, study, monkeypatch):
    """As larger fleets do. Programs are compiled as users' are and round otherwise; a search ends where another step
    promises a tenth of a standard error, and a hundredth is left for what rounding makes of that."""
    monkeypatch.setattr(calibrate.fit.command, "FEW", 1)
    out, again = fleet[0], study.parent / "in processes"
    outcome = run_command("fit", study, "--out", again)
    assert (outcome.status, outcome.err) == (0, "")
    for unit in ("unit_01", "unit_02"):
        assert any(line.startswith(f"{unit}: verdict: converged") for line in outcome.out.splitlines())
        together, apart = (read(folder / unit / "parameters.json")["parameters"] for folder in (out, again))
        for name, fields in apart.items():
            if fields["free"] is True:
                assert fields["value"] == pytest.approx(together[name]["value"], abs=0.01 * fields["std_error"])
                assert fields["std_error"] == pytest.approx(together[name]["std_error"], rel=0.01)


def test_a_second_run_does_nothing(fleet, study):
    out, _ = fleet
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    outcome = run_command("fit", study, "--out", out)
    assert outcome.status == 0
    assert outcome.out.startswith("nothing to do")
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


def test_simulate_takes_the_folder_of_a_fit(fleet, study, tmp_path):
    out, _ = fleet
    outcome = run_command("simulate", study, "--parameters", out, "--out", tmp_path / "simulated")
    assert (outcome.status, outcome.err) == (0, "")
    assert sorted(path.relative_to(tmp_path / "simulated").as_posix() for path in tmp_path.rglob("*.csv")) == [
        "unit_01/unit_01_a.csv",
        "unit_01/unit_01_b.csv",
        "unit_02/unit_02_a.csv",
    ]


def test_a_unit_that_fails_leaves_the_others_alone(fleet, study, tmp_path):
    out, _ = fleet
    for unit in ("unit_01", "unit_02"):
        content = read(out / unit / "parameters.json")
        if unit == "unit_01":
            # Past its soft stop the diaphragm would sweep its chamber twice.
            soft = {"diaphragm.travel": 2e-3, "diaphragm.stop_stiffness": 1e3, "chamber.volume": 7e-6}
            for name, value in soft.items():
                content["parameters"][name]["value"] = value
        (tmp_path / "start" / unit).mkdir(parents=True)
        (tmp_path / "start" / unit / "parameters.json").write_text(json.dumps(content))
    again = tmp_path / "out"
    outcome = run_command("fit", study, "--parameters", tmp_path / "start", "--out", again)
    assert outcome.status == 1
    assert outcome.err.startswith("failed: unit_01: the simulation with the start values fails")
    assert outcome.err.count("\n") == 1
    assert {path.name for path in (again / "unit_01").iterdir()} == {"summary.json"}
    assert {path.name for path in (again / "unit_02").iterdir()} == FILES
    whole = read(again / "summary.json")["units"]
    assert (whole["unit_01"]["converged"], whole["unit_02"]["converged"]) == (False, True)


def test_a_crash_between_units_keeps_the_finished_one(fleet, study, tmp_path, monkeypatch):
    """Whichever ends first: one with a trace to validate on has more to simulate."""
    finished = []

    def crash(job, unit, folder, outcome):
        if finished:
            raise MemoryError("no more")
        write(job, unit, folder, outcome)
        finished.append(unit.name)

    write, again = calibrate.fit.command._write, tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(calibrate.fit.command, "_write", crash)
        with pytest.raises(MemoryError, match="no more"):
            run_command("fit", study, "--out", again)
    (kept,) = finished
    written = (again / kept / "parameters.json").stat().st_mtime_ns
    outcome = run_command("fit", study, "--out", again)
    assert outcome.status == 0
    assert f"{kept}: {again / kept} holds its results\n" in outcome.out
    assert (again / kept / "parameters.json").stat().st_mtime_ns == written
    for unit in ("unit_01", "unit_02"):
        assert read(again / unit / "parameters.json") == read(fleet[0] / unit / "parameters.json")
        assert {path.name for path in (again / unit).iterdir()} == FILES
