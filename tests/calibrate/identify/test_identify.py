"""The command `identify`, as a user runs it, and a fit that starts from what it found."""

import numpy as np
import pytest
from commands import assert_refused, read, run_command
from support import EXAMPLE, optimised

import vgtjax
from calibrate.study.units import prepare
from vgtjax.identification import Identified
from vgtjax.parameters import move_inside

LOOPS = EXAMPLE / "loops" / "study.toml"
FILES = {".study.json", "parameters.json", "summary.json", "report.html"}


@pytest.fixture(scope="module", autouse=True)
def _optimised():
    """Fits along a minute and a half at 100 Hz."""
    with optimised():
        yield


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The folder of an identification of the loops that ship, and what the user saw."""
    out = tmp_path_factory.mktemp("identified") / "out"
    return out, run_command("identify", LOOPS, "--out", out)


@pytest.fixture(scope="module")
def summary(identified):
    return read(identified[0] / "summary.json")


def test_it_writes_its_files(identified):
    out, outcome = identified
    assert (outcome.status, outcome.err) == (0, "")
    assert {path.name for path in out.iterdir()} == FILES
    assert "vane force map [3.16]" in outcome.out


def test_every_test_of_the_plan_has_its_section(summary, identified):
    names = [section["name"] for section in summary["sections"]]
    assert len(names) == len(set(names))
    page = (identified[0] / "report.html").read_text(encoding="utf-8")
    for section in summary["sections"]:
        assert section["method"]
        assert f"[{section['equations']}]" in page
        # A test tells something, or says why it can't.
        assert section["values"] or section["unseen"]


def test_parameters_are_those_of_the_sections(summary, identified):
    parameters = read(identified[0] / "parameters.json")["parameters"]
    told = {name: value for section in summary["sections"] for name, value in section["values"].items()}
    assert set(summary["identified"]) == set(told)
    for name, value in told.items():
        np.testing.assert_allclose(parameters[name]["value"], value, rtol=1e-12)
        assert np.all(parameters[name]["free"])
    assert parameters["air.gas_constant"]["free"] is False


def test_loops_of_the_traces_have_their_widths(summary):
    widths = [trace["loop_width"]["measured"] / 100 for trace in summary["traces"].values()]
    assert widths == sorted(widths), "wider under more turbine pressure"
    assert 15 < widths[0] < 30  # mbar; twice 3 N over the diaphragm is 20


def test_a_second_run_does_nothing(identified):
    out, _ = identified
    before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    outcome = run_command("identify", LOOPS, "--out", out)
    assert outcome.status == 0
    assert outcome.out.startswith("nothing to do")
    assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == before


def test_a_fit_that_starts_from_it_meets_every_loop(identified, tmp_path):
    """Position RMSE at most 20 um and loop width within 2 %, at all three turbine pressures."""
    start = identified[0] / "parameters.json"
    outcome = run_command("fit", LOOPS, "--parameters", start, "--out", tmp_path / "fit")
    assert (outcome.status, outcome.err) == (0, "")
    fitted = read(tmp_path / "fit" / "summary.json")
    for trace in fitted["traces"].values():
        assert trace["rmse"]["x_d"] < 20e-6
        assert trace["loop_width"]["simulated"] == pytest.approx(trace["loop_width"]["measured"], rel=0.02)
    # White residuals: the model explains all but the sensors' noise.
    assert fitted["chi2_per_degree_of_freedom"] == pytest.approx(1.0, abs=0.1)


def test_bounds_hold_what_is_identified(tmp_path):
    """So that a fit of the same study can start from it."""
    text = LOOPS.read_text() + '\n[parameters]\n"diaphragm.preload" = {value = 55, lower = 54}\n'
    study = tmp_path / "study.toml"
    study.write_text(text.replace('"unit_01_*.csv"', f'"{LOOPS.parent}/unit_01_0000mbar.csv"'))
    unit = prepare(study, None).units[0]
    told = vgtjax.replace_parameters(unit.model, {"diaphragm.preload": 47.5, "diaphragm.stiffness": 11400.0})
    held = move_inside(told, unit.bounds)
    assert held.diaphragm.preload == 54.0
    assert held.diaphragm.stiffness == 11400.0


def test_a_study_without_a_trace_to_use(tmp_path):
    (tmp_path / "study.toml").write_text('[[trace]]\nfile = "a.csv"\nuse = "validate"\n')
    (tmp_path / "a.csv").write_bytes((EXAMPLE / "step_50.csv").read_bytes())
    outcome = run_command("identify", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert_refused(outcome, "study.toml: a fit needs at least one trace with use = 'fit'; mark one", tmp_path / "out")


def test_what_is_found_is_kept_where_a_trace_cannot_be_simulated_with_it(tmp_path, monkeypatch):
    def swallowed(model, _):
        values = {"chamber.volume": 1e-6}
        found = Identified("by hand", "2.41", values={name: np.asarray(value) for name, value in values.items()})
        yield vgtjax.replace_parameters(model, values), found

    monkeypatch.setattr("calibrate.identify.command.identify", swallowed)
    outcome = run_command("identify", LOOPS, "--out", tmp_path / "out")
    assert outcome.status == 0
    assert "the simulation of unit_01_0000mbar with these values failed: " in outcome.out
    assert read(tmp_path / "out" / "parameters.json")["parameters"]["chamber.volume"]["value"] == 1e-6
