"""The command `check` as a user runs it."""

import pytest
from commands import read, run_command


def test_it_says_what_is_known_and_what_would_help(small):
    outcome = run_command("check", small, "--out", small.parent / "out")
    assert (outcome.status, outcome.err) == (0, "")
    assert "expected relative errors" in outcome.out
    assert "runs to record next" in outcome.out
    said = read(small.parent / "out" / "summary.json")
    assert said["null"] == []
    assert set(said["expected_relative_error"]) >= {"diaphragm.stiffness", "diaphragm.preload"}
    assert all(0 < error < 1 for error in said["expected_relative_error"].values())
    assert {run["run"] for run in said["next"]} == {"step", "levels", "ramp", "slow loop"}
    gains = [run["gain"] for run in said["next"]]
    assert gains == sorted(gains, reverse=True)
    assert min(gains) >= 1
    first = said["next"][0]["lowers"]
    assert all(each["factor"] == pytest.approx(each["from"] / each["to"]) for each in first.values())
    page = (small.parent / "out" / "report.html").read_text()
    assert "What to record next" in page
    assert run_command("check", small, "--out", small.parent / "out").out.startswith("nothing to do")


def test_without_a_folder_it_only_says(small):
    before = sorted(small.parent.iterdir())
    outcome = run_command("check", small)
    assert (outcome.status, outcome.err) == (0, "")
    assert "diaphragm.stiffness" in outcome.out
    assert sorted(small.parent.iterdir()) == before


def test_what_cant_be_told_apart_is_said_before_a_fit_as_well(small):
    text = small.read_text().replace("free = [", 'free = ["diaphragm.damping", ')
    assert "diaphragm.damping" in text
    small.write_text(text)
    outcome = run_command("check", small, "--out", small.parent / "out")
    assert "diaphragm.damping, friction.viscous_damping can't be told apart: measure one of them" in outcome.out
    said = read(small.parent / "out" / "summary.json")
    assert ["diaphragm.damping", "friction.viscous_damping"] in said["null"]
    assert said["expected_relative_error"]["diaphragm.damping"] is None
    fit = run_command("fit", small, "--out", small.parent / "fit")
    assert "check: diaphragm.damping, friction.viscous_damping can't be told apart" in fit.out
    parameters = read(small.parent / "fit" / "parameters.json")["parameters"]
    assert not parameters["diaphragm.damping"]["identifiable"]
    assert not parameters["friction.viscous_damping"]["identifiable"]


def test_traces_that_tell_nothing_are_a_failure(small):
    small.write_text(
        'model = "mechanical"\n[[trace]]\nfile = "step_80.csv"\n[fit]\n'
        'free = ["diaphragm.damping", "friction.viscous_damping"]\n'
    )
    outcome = run_command("check", small, "--out", small.parent / "out")
    assert outcome.status == 1
    assert outcome.err == "failed: this study: these traces determine none of the free parameters\n"
    errors = read(small.parent / "out" / "summary.json")["expected_relative_error"]
    assert set(errors.values()) == {None}
    # A fit says the same before its first step, and ends.
    fit = run_command("fit", small, "--out", small.parent / "fit")
    assert fit.status == 1
    assert "these traces determine none of the free parameters; diaphragm.damping, friction.viscous_damping" in fit.err
    assert "these traces determine none" in read(small.parent / "fit" / "summary.json")["error"]


def test_a_mistake_in_the_study_is_one_sentence(small):
    small.write_text(small.read_text() + '\n[fittt]\nfree = ["x"]\n')
    outcome = run_command("check", small)
    assert outcome.status == 2
    assert outcome.err.startswith("error: ")
    assert outcome.err.count("\n") == 1
