"""The README says what is true: its code runs, its commands are CI's, its files exist."""

import pathlib
import re
import shlex
import tomllib

import numpy as np
import pytest
from commands import read, run_command
from support import EXAMPLE

import vgtjax
from calibrate.study.channels import sources_of
from calibrate.study.components import CHAMBER, FRICTION, LINE, MAGNETIC_FORCE, VANE_FORCE
from calibrate.study.models import build_model, start_values
from calibrate.study.references import build_references
from calibrate.study.tables import AnyStudy
from calibrate.tune.designs import DESIGNS

ROOT = pathlib.Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
NOTEBOOKS = sorted(f"notebooks/{path.name}" for path in (ROOT / "notebooks").glob("*.ipynb"))


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_python_example_runs(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(vgtjax, "configure", lambda: None)  # the session is configured already
    scope = {}
    exec(python_with("vgtjax.simulate"), scope)
    assert scope["solution"].x_d.shape == scope["trace"].time.shape
    assert scope["slopes"].shape == (len(scope["trace"].time), 2, 8)


def test_python_closed_loops_run():
    scope = {}
    exec(python_with("close_loops"), scope)
    known, stiffer = scope["loops"].pressure_rms
    assert not scope["loops"].failed.any()
    # What is wrong with the believed spring is taken for pressure: 5 N over the diaphragm's area are 1.7 kPa.
    assert known < 0.5 * stiffer


def python_with(name):
    """The Python example that has a name in it."""
    return next(text for text in blocks("python") if name in text)


def test_python_population_runs():
    scope = {}
    exec(python_with("spread_population"), scope)
    assert scope["width"].shape == (256,)
    assert not scope["results"].failed.any()


@pytest.mark.parametrize("text", blocks("toml"))
def test_study_examples_are_studies(text):
    study = AnyStudy.validate_python({"trace": [{"file": "any.csv"}]} | tomllib.loads(text))
    model = build_model(study)
    values, _ = start_values(model, study.parameters)
    assert set(values) == {name for name, given in study.parameters.items() if given.value is not None}
    assert vgtjax.select(model, study.fit.free, study.fit.fixed).entries


def test_the_controller_of_the_example_can_be_built():
    control = next(found.control for text in blocks("toml") if (found := _study(text)).control.gains)
    controller = DESIGNS[control.design].for_plant(vgtjax.Actuator())
    assert vgtjax.select(controller, free=control.free).entries
    assert set(start_values(controller, control.gains)[0]) == set(control.gains)
    assert len(build_references(control.reference, ROOT)) == 2


def _study(text):
    return AnyStudy.validate_python(tomllib.loads(text))


def test_every_component_is_named():
    listed = next(text for text in blocks("toml") if text.startswith("[components]\nfriction"))
    for registry in (FRICTION, VANE_FORCE, LINE, MAGNETIC_FORCE, CHAMBER):
        for name in registry:
            assert re.search(rf"\b{name}\b", listed), name


def test_every_design_is_named():
    listed = next(text for text in blocks("toml") if "[control]" in text)
    for name in DESIGNS:
        assert re.search(rf"\b{name}\b", listed), name


@pytest.fixture(scope="module")
def from_a_recording() -> list[list[str]]:
    """The three commands from an installation to the report of an MDF file."""
    text = next(each for each in blocks("bash") if "example/logger" in each)
    return [shlex.split(line, comments=True) for line in text.splitlines()]


def test_a_recording_needs_an_extra_that_exists(from_a_recording):
    install, *_ = from_a_recording
    assert install[:2] == ["pip", "install"]
    (extras,) = re.findall(r"^vgtjax\[(.*)\]$", install[2])
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert set(extras.split(",")) <= set(project["optional-dependencies"])


def test_a_recording_becomes_a_report(from_a_recording, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    _, *commands = from_a_recording
    assert len(commands) == 2
    for number, (*python, name, study, flag, _) in enumerate(commands):
        assert (python, flag) == (["python", "-m", "calibrate"], "--out")
        outcome = run_command(name, study, flag, tmp_path / str(number))
        assert (outcome.status, outcome.err) == (0, "")
    assert {path.name for path in (tmp_path / "0").glob("*.csv")} == {"levels_1.csv", "step_80.csv"}
    summary = read(tmp_path / "1" / "summary.json")
    assert summary["converged"]
    # The noise of the sensors; a step to 80 % has more than random levels told, so what was not fitted leaves half as
    # much again.
    noise, left = {"x_d": 8e-6, "p_act": 60.0}, summary["traces"]
    assert left["levels_1"]["rmse"] == pytest.approx(noise, rel=0.1)
    assert all(left["step_80"]["rmse"][name] < 1.5 * noise[name] for name in noise)
    assert "levels_1" in (tmp_path / "1" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["levels_1", "step_80"])
def test_a_recording_of_the_example_is_its_csv_to_half_a_count(name):
    study = AnyStudy.validate_python(tomllib.loads((EXAMPLE / "logger" / "study.toml").read_text(encoding="utf-8")))
    found = vgtjax.load_trace(EXAMPLE / "logger" / f"{name}.mf4", channels=sources_of(study.channels))
    wanted = vgtjax.load_trace(EXAMPLE / f"{name}.csv")
    counts = {"pwm": 0.01, "p_act": 5.0, "p_res": 5.0, "x_d": 5e-7}
    assert set(found.channels) == set(counts)
    for signal, count in counts.items():
        every = 2 if signal == "x_d" else 1
        np.testing.assert_array_equal(found.channels[signal].time, wanted.channels[signal].time[::every])
        values = wanted.channels[signal].value[::every]
        np.testing.assert_allclose(found.channels[signal].value, values, rtol=0, atol=0.5001 * count)


def test_ci_finds_both_commands():
    commands = blocks("bash")
    assert "-m calibrate fit --out out/example" in commands[0]
    assert commands[1].rstrip().endswith("-m pytest")
    for command in commands[:2]:
        assert command.startswith("python3 -m venv .venv && ")
        assert command.count("\n") == 1  # .ci/run takes one line


@pytest.mark.parametrize("target", re.findall(r"\]\((?!http)([^)]+)\)", README))
def test_links_lead_somewhere(target):
    assert (ROOT / target).exists()


def test_the_example_is_small():
    # Beside the 5 MB of the plot library that every report carries; the loops of twenty units are a third of it.
    assert sum(file.stat().st_size for file in EXAMPLE.rglob("*.csv")) < 4e6


@pytest.mark.parametrize("path", ["README.md", "CONTRIBUTING.md", "docs/control.md", *NOTEBOOKS])
def test_what_ships_is_not_called_measured(path):
    text = (ROOT / path).read_text(encoding="utf-8")
    assert not re.search(r"real bench|bench unit|measured (units|loops|actuator)|noise of the\W+bench", text)


def test_readme_says_that_all_traces_are_simulated():
    assert "nothing that ships was measured" in README
