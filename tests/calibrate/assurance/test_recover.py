"""The command `recover` as a user runs it."""

import hashlib
import types

import numpy as np
import pytest
from commands import read, run_command, timeless
from pages import Page

from calibrate.assurance.recover.command import _common_delay
from vgtjax.estimation import FoundDuty

pytestmark = pytest.mark.usefixtures("kept")

CAMPAIGNS = 3


@pytest.fixture(scope="module")
def recovered(fitted, tmp_path_factory):
    out = tmp_path_factory.mktemp("recover") / "out"
    arguments = ("--parameters", fitted.out / "parameters.json", "--campaigns", str(CAMPAIGNS))
    return out, arguments, run_command("recover", fitted.study, "--out", out, *arguments)


def test_bias_coverage_and_spread_of_every_parameter(recovered):
    out, _, outcome = recovered
    assert (outcome.status, outcome.err) == (0, "")
    said = read(out / "summary.json")
    assert (said["campaigns"], said["failed"]) == (CAMPAIGNS, [])
    entries = set(said["coverage"])
    assert len(entries) == 4
    assert all(set(said[name]) == entries for name in ("bias", "spread", "claimed", "determined"))
    assert all(0 <= share <= 1 for share in said["coverage"].values())
    for name in entries:
        # Of three estimates a deviation is hardly wrong by a factor of ten.
        assert 0.1 < said["spread"][name] / said["claimed"][name] < 10
    assert said["sentences"][0] in outcome.out
    assert "this cannot show a wrong structure" in said["sentences"][-1]
    page = (out / "report.html").read_text()
    assert "this cannot show" in page


def test_the_report_shows_the_summary(recovered):
    out, _, _ = recovered
    said, page = read(out / "summary.json"), Page((out / "report.html").read_text(encoding="utf-8"))
    rows = page.table("parameter", "determined in")
    assert [row["parameter"] for row in rows] == list(said["coverage"])
    for row in rows:
        bias, spread, claimed = (said[key][row["parameter"]] for key in ("bias", "spread", "claimed"))
        assert row == {
            "parameter": row["parameter"],
            "determined in": f"{said['determined'][row['parameter']]:.0f}",
            "hold the truth": f"{100 * said['coverage'][row['parameter']]:.3g} %",
            "bias / claimed error": f"{bias / claimed:.2g}",
            "true spread": f"{spread:.3g}",
            "claimed error": f"{claimed:.3g}",
            "ratio": f"{spread / claimed:.3g}",
        }
    assert page.texts["b"] == [f"{100 * said['coverage_of_all']:.3g} %", str(len(said["failed"]))]
    assert page.texts["li"] == [f"{sentence}." for sentence in said["sentences"]]
    for name, scores in said["scores"].items():
        assert np.mean(np.abs(scores) <= 1.959964) == pytest.approx(said["coverage"][name])


def test_the_options_of_the_command_stand_in_the_report(recovered, fitted):
    page = Page((recovered[0] / "report.html").read_text(encoding="utf-8"))
    digest = hashlib.sha256((fitted.out / "parameters.json").read_bytes()).hexdigest()
    words = f"recover study.toml --parameters parameters.json --campaigns {CAMPAIGNS} --out DIR"
    assert f"python -m calibrate {words}" in page.texts["code"]
    assert digest[:16] in page.texts["code"]


def test_values_that_were_not_fitted_are_refused(fitted, tmp_path):
    """What such a model leaves over would count as noise: every campaign took minutes and determined nothing."""
    outcome = run_command("recover", fitted.study, "--out", tmp_path / "out", "--campaigns", "2")
    assert outcome.status == 2
    assert "a recovery needs a model that was fitted to its traces, but this one leaves" in outcome.err
    assert not list((tmp_path / "out").iterdir())


def test_a_second_run_does_nothing_but_more_campaigns_are_another_study(recovered, fitted):
    out, arguments, _ = recovered
    assert run_command("recover", fitted.study, "--out", out, *arguments).out.startswith("nothing to do")
    more = run_command("recover", fitted.study, "--out", out, *arguments[:3], "5")
    assert more.status == 2
    assert more.err.startswith(f"error: {out} holds the results of another study")


def test_an_interrupted_recovery_keeps_its_campaigns(recovered, fitted, tmp_path, monkeypatch):
    """The same figures as without interruption."""
    from calibrate.assurance.recover import command

    out, arguments, _ = recovered
    saves, usual = [], command.ProgressFile.save

    def save(self, progress, **facts):
        usual(self, progress, **facts)
        saves.append(progress)
        if len(saves) == 2:
            raise RuntimeError("killed")

    monkeypatch.setattr(command.ProgressFile, "save", save)
    with pytest.raises(RuntimeError, match="killed"):
        run_command("recover", fitted.study, "--out", tmp_path / "out", *arguments)
    monkeypatch.undo()
    again = run_command("recover", fitted.study, "--out", tmp_path / "out", *arguments)
    assert "resuming after step 2" in again.out
    expected, found = read(out / "summary.json"), read(tmp_path / "out" / "summary.json")
    assert {**found, "wall_seconds": 0} == {**expected, "wall_seconds": 0}
    assert timeless(out / "report.html") == timeless(tmp_path / "out" / "report.html")


@pytest.mark.parametrize(
    ("found", "delay"),
    [
        ({"a": FoundDuty(0.004, False), "b": FoundDuty(0.004, False)}, 0.004),
        ({"a": FoundDuty(0.004, False), "b": FoundDuty(0.003, False)}, 0.0),
        ({"a": FoundDuty(0.004, False)}, 0.0),
        ({"a": FoundDuty(0.004, False, (-1e-3,)), "b": FoundDuty(0.004, False)}, 0.0),
        ({"a": FoundDuty(0.004, True), "b": FoundDuty(0.004, True)}, 0.0),
    ],
    ids=["late", "differs", "not of all", "edges beside it", "linear"],
)
def test_campaigns_begin_late_where_nothing_but_one_delay_was_found(found, delay):
    """What else a fit has found of a duty, campaigns have to find again: they begin as that fit did."""
    traces = [types.SimpleNamespace(name=name, duty_late=0.0) for name in "ab"]
    assert _common_delay(types.SimpleNamespace(duties=found), traces) == delay
