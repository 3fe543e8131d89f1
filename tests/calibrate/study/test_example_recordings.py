"""The two recordings of a logger that ship: from the manual's commands to a report."""

import tomllib

import numpy as np
import pytest
from commands import read, run_command
from markdown_pages import DOCS, ROOT
from support import EXAMPLE

import vgtjax
from calibrate.manual.markdown import commands
from calibrate.study.channels import sources_of
from calibrate.study.tables import AnyStudy


def test_a_recording_becomes_a_report(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    shown = [words for words in commands(DOCS / "files.md") if "calibrate/example/logger/study.toml" in words]
    assert len(shown) == 2
    for number, (*python, name, study, flag, _) in enumerate(shown):
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
