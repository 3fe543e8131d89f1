"""What a fit finds out besides the parameters, as a user of the command line meets it."""

import json

import numpy as np
import pytest
from commands import read, run_command

import vgtjax
from vgtjax.estimation._found import delay_found

FREE = ["diaphragm.stiffness", "diaphragm.preload", "chamber.volume"]
LATE = 4
"""ms."""
STUDY = f"""
[[trace]]
file = "late.csv"

[fit]
free = {FREE}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A simulated trace, with noise, whose duty reached the valve 4 ms later than its file says; and a fit of it."""
    folder = tmp_path_factory.mktemp("late")
    duty = np.repeat([0.0, 70.0, 40.0, 60.0], [50, 350, 300, 300])
    time = np.arange(len(duty)) * 1e-3
    applied = vgtjax.Trace(time, pwm=np.concatenate([np.zeros(LATE), duty[:-LATE]]), p_res=np.full(len(time), 2e4))
    run, rng = vgtjax.simulate(vgtjax.Actuator(), applied), np.random.default_rng(4)
    x_d = 1e3 * (np.asarray(run.x_d) + rng.normal(0, 8e-6, len(time)))
    p_act = np.asarray(run.p_act) + rng.normal(0, 60.0, len(time))
    rows = np.column_stack([time, duty, np.full(len(time), 2e4), p_act, x_d])
    header = "time [s],pwm [%],p_res [Pa absolute],p_act [Pa absolute],x_d [mm]"
    np.savetxt(folder / "late.csv", rows, "%.6f", ",", header=header, comments="")
    (folder / "study.toml").write_text(STUDY)
    outcome = run_command("fit", folder / "study.toml", "--out", folder / "out")
    assert (outcome.status, outcome.err) == (0, "")
    assert "found: the duty reaches the valve " in outcome.out
    return folder


def test_the_delay_is_in_every_file(folder):
    summary, parameters = read(folder / "out/summary.json"), read(folder / "out/parameters.json")
    assert parameters["schema"] == 2
    assert abs(summary["duty_delay"] - 4e-3) < 4 * summary["duty_delay_std_error"] < 1e-3
    assert parameters["nuisance"]["late"]["duty_delay"] == summary["duty_delay"]
    assert summary["corrections"]["settled"] is True
    assert set(summary["corrections"]["moved"]) == set(FREE)
    assert summary["traces"]["late"]["sensors"]["x_d"]["noise"] == pytest.approx(8e-6, rel=0.1)
    assert "The duty reaches the valve" in (folder / "out/report.html").read_text()


@pytest.mark.parametrize(
    ("delay", "error"), [(-0.3, 0.05), (-0.3, 0.2), (0.3, 0.05), (-0.3, np.inf), (0.3, np.nan), (-0.3, np.nan)]
)
def test_a_duty_that_comes_before_its_record_is_named_as_a_fault(delay, error):
    """One unit with filtered noise was met to its noise so, with values six standard errors off."""
    assert ("unless its clock is another" in delay_found(delay, error)) == (delay < -3 * error)


def test_simulate_applies_the_delay_that_a_fit_has_found(folder):
    """The simulated trace then meets the file to the sensor's noise; without the delay it does not."""

    def remains(name, parameters):
        out = folder / name
        outcome = run_command("simulate", folder / "study.toml", "--parameters", parameters, "--out", out)
        assert outcome.status == 0
        simulated = vgtjax.load_trace(out / "late.csv").x_d
        return float(np.std(simulated - vgtjax.load_trace(folder / "late.csv").x_d))

    plain = read(folder / "out/parameters.json")
    del plain["nuisance"], plain["schema"]  # as earlier versions wrote it
    (folder / "plain.json").write_text(json.dumps(plain))
    assert remains("with", folder / "out/parameters.json") == pytest.approx(8e-6, rel=0.1)
    assert remains("without", folder / "plain.json") > 3e-5


def test_a_delay_that_the_study_states_is_not_looked_for(folder):
    (folder / "stated.toml").write_text(STUDY.replace("late.csv", 'late.csv"\nduty_delay = 0.004\n#"'))
    assert run_command("fit", folder / "stated.toml", "--out", folder / "stated").status == 0
    summary = read(folder / "stated/summary.json")
    assert (summary["duty_delay"], summary["duty_delay_std_error"]) == (0.0, None)
    assert summary["traces"]["late"]["rmse"]["x_d"] == pytest.approx(8e-6, rel=0.1)


def test_another_duty_that_was_found_is_another_run(folder, tmp_path):
    """What is simulated depends on more of a parameters.json than on its values."""
    found, arguments = (
        read(folder / "out/parameters.json"),
        ("--parameters", tmp_path / "p.json", "--out", tmp_path / "o"),
    )
    (tmp_path / "p.json").write_text(json.dumps(found))
    assert run_command("simulate", folder / "study.toml", *arguments).status == 0
    found["nuisance"]["late"] = {"duty_delay": 0.02}
    (tmp_path / "p.json").write_text(json.dumps(found))
    again = run_command("simulate", folder / "study.toml", *arguments)
    assert again.status == 2
    assert "holds the results of another study" in again.err


def test_edges_that_were_found_are_where_a_simulation_has_them(folder, tmp_path):
    """As a trace whose duty was so late; as many as another trace has are those of another trace."""
    trace, found = vgtjax.load_trace(folder / "late.csv"), read(folder / "out/parameters.json")
    count = len(trace.edges())

    def simulated(**nuisance):
        found["nuisance"]["late"] = nuisance
        (tmp_path / "p.json").write_text(json.dumps(found))
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        arguments = (folder / "study.toml", "--parameters", tmp_path / "p.json", "--out", out)
        assert run_command("simulate", *arguments).status == 0
        return vgtjax.load_trace(out / "late.csv").x_d

    # A millisecond is a sample of this record. An edge keeps 1 us from it, in which the rod goes 0.05 um at most.
    np.testing.assert_allclose(simulated(duty_edges=[1e-3] * count), simulated(duty_delay=1e-3), atol=1e-7)
    np.testing.assert_array_equal(simulated(duty_edges=[1e-3] * (count + 1)), simulated())


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"schema": 3}, "p.json: its schema must be a number from 1 to 2, but it is 3; use a newer vgtjax"),
        ({"nuisance": [1]}, "p.json: its nuisance must be a table for each trace, but it is not; correct it"),
        (
            {"nuisance": {"late": {"duty_delay": "4 ms"}}},
            "p.json: the duty_delay of 'late' must be seconds between -1 and 1, but it is '4 ms'; correct it",
        ),
        (
            {"nuisance": {"late": {"duty_edges": [2.0]}}},
            "p.json: the duty_edges of 'late' must be a list of seconds between -1 and 1, but they are [2.0]; correct "
            "them",
        ),
    ],
)
def test_parameters_that_say_nonsense_of_traces_are_refused(folder, tmp_path, change, sentence):
    (tmp_path / "p.json").write_text(json.dumps({**read(folder / "out/parameters.json"), **change}))
    arguments = (folder / "study.toml", "--parameters", tmp_path / "p.json", "--out", tmp_path / "out")
    outcome = run_command("simulate", *arguments)
    assert (outcome.status, outcome.err) == (2, f"error: {sentence}\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "line", ['loss = "cauchy"', 'profiles = "some"', 'unknown = {noise = "pink"}', "unknown = {duty_hold = true}"]
)
def test_an_unknown_choice_is_refused(folder, tmp_path, line):
    (folder / "wrong.toml").write_text(STUDY + line + "\n")
    outcome = run_command("fit", folder / "wrong.toml", "--out", tmp_path / "out")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1


def test_a_ramped_duty_is_written_as_its_mean(folder):
    assert vgtjax.load_trace(folder / "late.csv").pwm[49] == 0.0
    (folder / "ramped.toml").write_text(STUDY.replace("late.csv", 'late.csv"\nduty_hold = "linear"\n#"'))
    assert run_command("simulate", folder / "ramped.toml", "--out", folder / "ramped").status == 0
    assert vgtjax.load_trace(folder / "ramped/late.csv").pwm[49] == pytest.approx(35.0)
