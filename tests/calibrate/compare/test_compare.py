"""The command `compare` on a rod driven by its pressure: friction is told from traces of an independent plant."""

import dataclasses
import math
import pathlib
from types import SimpleNamespace

import numpy as np
import pytest
from commands import Outcome, cut_example, read, run_command
from pages import Page
from report_numbers import assert_cards, assert_shown, shown

import vgtjax
from calibrate.compare import alternatives, command, verdict
from calibrate.fit.plan import plan as plan_of_fit
from calibrate.output.files import MARKER
from calibrate.study.units import prepare

FRICTION = ("lugre", "coulomb")
STUDY = """name = "rod"
model = "mechanical"
[[trace]]
file = "step_80.csv"
[[trace]]
file = "step_50.csv"
use = "validate"
[fit]
free = ["diaphragm.preload", "diaphragm.stiffness", "friction.coulomb_force", "friction.viscous_damping"]
"""


@dataclasses.dataclass(frozen=True)
class Compared:
    """A study, what a comparison of it wrote, and what the user saw."""

    study: pathlib.Path
    out: pathlib.Path
    outcome: Outcome


@pytest.fixture(scope="module")
def few():
    """Only two variants of friction, to be quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(alternatives, "FRICTION", FRICTION)
        yield


@pytest.fixture(scope="module")
def compared(tmp_path_factory, few) -> Compared:
    folder = tmp_path_factory.mktemp("compare")
    for name in ("step_80", "step_50"):
        cut_example(name, 1.2, folder)
    (folder / "study.toml").write_text(STUDY)
    outcome = run_command("compare", folder / "study.toml", "--out", folder / "out")
    return Compared(folder / "study.toml", folder / "out", outcome)


def test_the_contract(compared):
    assert (compared.outcome.status, compared.outcome.err) == (0, "")
    assert {path.name for path in compared.out.iterdir()} == {MARKER, "summary.json", "report.html"}
    summary = read(compared.out / "summary.json")
    assert set(summary["chosen"]) == set(summary["decided"]) == {"vane_force", "friction", "stribeck_exponent"}
    assert summary["chosen"]["vane_force"] == "none"
    assert summary["decided"]["vane_force"] is False
    assert summary["reasons"]["vane_force"] == "the turbine pressure is zero in all traces"
    assert [row["name"] for row in summary["table"]] in (["lugre", "coulomb"], ["coulomb", "lugre"])


DIGITS = {
    "χ²": ("chi2", 7),
    "parameters determined": ("parameters", 3),
    "criterion": ("criterion", 7),
    "score": ("score", 5),
    "lower by": ("difference", 4),
    "steady": ("steadiness", 3),
    "unseen": ("unseen", 3),
}
"""Columns of the table of structures: what of the summary they show, and how many digits."""


def test_the_report_shows_the_numbers_of_the_summary(compared):
    summary, text = read(compared.out / "summary.json"), (compared.out / "report.html").read_text()
    page = Page(text)
    structures = [
        {"structure": row["name"], **{name: shown(row[key], digits) for name, (key, digits) in DIGITS.items()}}
        for row in summary["table"]
    ]
    assert_shown(page.table("component", "structure"), structures)
    assert any(row["lower by"] for row in structures)
    remains = [
        {"signal": row["channel"], "over": row["over"], "number": shown(row["number"], 3), "p": shown(row["p"], 2)}
        for row in summary["remains"]
    ]
    assert_shown(page.table("signal", "over"), remains)
    chosen = {name: value for name, value in summary["chosen"].items() if isinstance(value, int | float)}
    assert_cards(page, {name: shown(value, 4) for name, value in chosen.items()})
    for name, reason in summary["reasons"].items():
        assert f"{name}: {reason}." in page.text("li").replace("\n", "")
    for words in ("as of noise", "the turbine pressure is zero in all traces", "search"):
        assert words in text


def test_a_second_run_does_nothing(compared):
    outcome = run_command("compare", compared.study, "--out", compared.out)
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith(f"nothing to do: {compared.out} holds the results already\n")


def test_an_interrupted_comparison_keeps_its_finished_fits(compared, tmp_path, monkeypatch):
    def killed(*arguments):
        raise RuntimeError("killed")

    with monkeypatch.context() as patch:
        patch.setattr(command, "judge", killed)
        with pytest.raises(RuntimeError, match="killed"):
            run_command("compare", compared.study, "--out", tmp_path / "out")
    # The first begins at the values of the study, the other one at the end of the first.
    assert {path.name for path in (tmp_path / "out" / command.FITS).iterdir()} >= {"none+lugre+own", "none+coulomb"}
    outcome = run_command("compare", compared.study, "--out", tmp_path / "out")
    assert outcome.out.count("resuming after step") >= 2
    resumed, whole = (read(folder / "summary.json") for folder in (tmp_path / "out", compared.out))
    assert {**resumed, "wall_seconds": 0} == {**whole, "wall_seconds": 0}


def test_bad_input_is_one_sentence(compared, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(STUDY.replace("diaphragm.preload", "diaphragm.prelaod"))
    for name in ("step_80", "step_50"):
        cut_example(name, 1.2, tmp_path)
    outcome = run_command("compare", study, "--out", tmp_path / "out")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.startswith("error: ")
    assert "did you mean 'diaphragm.preload'?" in outcome.err
    assert not (tmp_path / "out").exists()


def test_every_structure_is_fitted_with_what_the_study_knows_beforehand(tmp_path):
    """Tolerances, priors and certificates, as `fit` has them; of another structure those that it has a place for."""
    cut_example("step_80", 0.6, tmp_path)
    (tmp_path / "study.toml").write_text(
        """
[[trace]]
file = "step_80.csv"
[parameters]
"diaphragm.stiffness" = {value = 12000, deviation = 1.0}
"diaphragm.area" = {relative = 0.02}
[[report.sensor]]
channel = "x_d"
relative_uncertainty = 0.001
"""
    )
    job = prepare(tmp_path / "study.toml", None, to_fit=True)
    (unit,) = job.units
    for structure in ({}, {"friction": "dahl"}):
        task = alternatives.plan(job, unit, structure, {})
        assert task.deviations == plan_of_fit(job, unit).deviations
        assert task.gains == {"x_d": 0.001}
        # Begun where another structure's fit has ended, a prior is still about what the study states.
        moved = alternatives.plan(job, unit, structure, {"diaphragm.stiffness": 13000.0})
        assert float(moved.model.diaphragm.stiffness) == 13000.0
        assert float(moved.prior.center[moved.selection.entries.index("diaphragm.stiffness")]) == math.log(12000.0)


def test_what_is_stated_of_one_unit_is_not_said_of_another():
    calibration = SimpleNamespace(
        task=SimpleNamespace(fit=[vgtjax.Trace(np.arange(3) / 500, pwm=np.zeros(3), name="levels")]),
        duty_hold=lambda trace: "zero-order",
        duty_delay=1.1e-3,
        progress=SimpleNamespace(hold_decided=True, linear=()),
    )
    compared = SimpleNamespace(fit=SimpleNamespace(calibration=calibration))
    model = vgtjax.Actuator()
    stating, other = (SimpleNamespace(model=model, stated=stated) for stated in ({"duty_delay": [4e-3]}, {}))
    said = verdict._duty(stating, compared, far=False)["duty_delay"]
    assert (said.value, said.decided) == (4e-3, False)
    found = verdict._duty(other, compared, far=False)["duty_delay"]
    assert (found.value, found.decided) == (1.1e-3, True)


def test_the_hold_is_that_of_the_slowest_traces():
    traces = [vgtjax.Trace(np.arange(3) / rate, pwm=np.zeros(3), name=f"{rate}") for rate in (100, 1000)]
    calibration = SimpleNamespace(
        task=SimpleNamespace(fit=traces),
        duty_hold=lambda trace: "linear" if trace.name == "100" else "zero-order",
        duty_delay=0.0,
        progress=SimpleNamespace(hold_decided=True, linear=(0.01,)),
    )
    compared = SimpleNamespace(fit=SimpleNamespace(calibration=calibration))
    said = verdict._duty(SimpleNamespace(model=vgtjax.Actuator(), stated={}), compared, far=False)["duty_hold"]
    assert (said.value, said.decided) == ("linear", True)
    assert said.reason.endswith(
        "10 ms per sample: how the duty of others was held may be open, and the delay with it by "
        "half a sample of theirs, 0.5 ms of the fastest"
    )


def test_exponents_are_alike():
    """Those of LuGre's law with an exponent, whichever its parameters."""
    assert alternatives.ALIKE == {
        "lugre": ("lugre-squared",),
        "lugre-passive": ("lugre-squared",),
        "lugre-squared": ("lugre", "lugre-passive"),
    }
