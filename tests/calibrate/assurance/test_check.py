"""The command `check` as a user runs it."""

import re

import pytest
from commands import UNSEEN, read, run_command, timeless
from pages import Page

pytestmark = pytest.mark.usefixtures("kept")


@pytest.fixture(scope="module")
def checked(fitted, tmp_path_factory):
    """The folder of a check of the small study."""
    out = tmp_path_factory.mktemp("check") / "out"
    assert run_command("check", fitted.study, "--out", out).status == 0
    return out


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
    (exact,) = [sentence for sentence in said["sentences"] if "for exact" in sentence]
    assert "the gains of the sensors of x_d and p_act" in exact
    assert exact in outcome.out
    page = (small.parent / "out" / "report.html").read_text()
    assert "What to record next" in page
    assert run_command("check", small, "--out", small.parent / "out").out.startswith("nothing to do")


def test_the_report_shows_the_summary(checked):
    said, page = read(checked / "summary.json"), Page((checked / "report.html").read_text(encoding="utf-8"))
    rows = page.table("run", "length, s")
    assert len(rows) == len(said["next"]) > 0
    for row, run in zip(rows, said["next"], strict=True):
        lowers = [f"{name} {100 * each['from']:.2g} to {100 * each['to']:.2g}" for name, each in run["lowers"].items()]
        assert row == {
            "run": run["run"],
            "length, s": f"{run['seconds']:.3g}",
            "rate, Hz": f"{run['rate']:.4g}",
            "turbine, mbar": f"{run['turbine_pressure'] / 100:.4g}",
            "factor": f"{run['gain']:.3g}",
            "relative error, % before and after": "; ".join(lowers),
        }
    words = [f"{sentence}." for sentence in said["sentences"]]
    assert [text for text in [*page.texts.get("li", []), *page.texts["p"]] if text in words] == words


def test_two_reports_are_the_same_but_for_date_and_time(small):
    first, second = (small.parent / name for name in ("first", "second"))
    for out in (first, second):
        assert run_command("check", small, "--out", out).status == 0
    assert timeless(first / "report.html") == timeless(second / "report.html")


def test_without_a_folder_it_only_says(small):
    before = sorted(small.parent.iterdir())
    outcome = run_command("check", small)
    assert (outcome.status, outcome.err) == (0, "")
    assert "diaphragm.stiffness" in outcome.out
    assert sorted(small.parent.iterdir()) == before


def test_what_cant_be_told_apart_is_said_before_a_fit_as_well(small):
    text, free = small.read_text(), f"free = {UNSEEN}"
    small.write_text(re.sub(r"free = \[.*\]", free, text))
    assert free in small.read_text()
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
