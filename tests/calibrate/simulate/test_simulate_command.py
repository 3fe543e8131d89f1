"""`simulate` writes what the model does, in files that read back."""

import json
import re

import numpy as np
import pytest
from commands import cut_example, read, run_command

import vgtjax

HEADER = (
    "time [s],pwm [%],p_res [Pa absolute],x_p [m],v_p [m/s],x_d [m],v_d [m/s],z [m],T_act [K],p_act [Pa absolute],"
    "m_dot_in [kg/s],m_dot_out [kg/s]"
)
STATES = ("x_p", "v_p", "x_d", "v_d", "z", "T_act", "p_act", "m_dot_in", "m_dot_out")


@pytest.fixture(scope="module")
def simulated(fitted, tmp_path_factory):
    """The small study, simulated."""
    out = tmp_path_factory.mktemp("simulated") / "a" / "b"
    return out, run_command("simulate", fitted.study, "--out", out)


def columns(path):
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    return dict(zip(header.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))


def test_a_file_a_trace_fit_and_validate(simulated):
    out, outcome = simulated
    assert (outcome.status, outcome.err) == (0, "")
    assert {path.name for path in out.iterdir()} == {".study.json", "step_80.csv", "step_50.csv"}
    assert outcome.out == f"wrote {out / 'step_80.csv'}\nwrote {out / 'step_50.csv'}\n"


def test_headers_are_those_of_the_reference(simulated):
    assert (simulated[0] / "step_80.csv").read_text().partition("\n")[0] == HEADER


@pytest.mark.parametrize("name", ["step_80", "step_50"])
def test_values_are_those_of_the_library(actuator, fitted, simulated, name):
    trace = vgtjax.load_trace(
        fitted.study.parent / f"{name}.csv", atmosphere=101100.0 if name == "step_50" else 101013.0
    )
    stated = vgtjax.replace_parameters(actuator, {"diaphragm.stiffness": 11500.0})
    solution = vgtjax.simulate(stated, trace)
    written = columns(simulated[0] / f"{name}.csv")
    for header, values in written.items():
        state = header.split(" ")[0]
        expected = getattr(solution, state) if state in STATES else getattr(trace, state)
        np.testing.assert_allclose(values, expected, rtol=6e-9)  # nine digits are written


def test_no_negative_zeros_are_written(simulated):
    assert ",-0," not in (simulated[0] / "step_80.csv").read_text()


def test_what_is_written_reads_back_as_a_trace(fitted, simulated):
    given = vgtjax.load_trace(fitted.study.parent / "step_80.csv")
    trace = vgtjax.load_trace(simulated[0] / "step_80.csv", needs=("pwm", "p_act", "x_d"))
    np.testing.assert_allclose(trace.time, given.time, rtol=1e-8)
    np.testing.assert_array_equal(trace.pwm, given.pwm)
    np.testing.assert_allclose(trace.p_res, given.p_res, rtol=1e-8)
    ignored = [name for name in STATES if name not in ("x_d", "p_act")]
    assert trace.notes == tuple(f"column '{name}' is not used" for name in ignored)


def test_a_second_run_does_nothing(fitted, simulated):
    out, _ = simulated
    before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    outcome = run_command("simulate", fitted.study, "--out", out)
    assert outcome.status == 0
    assert outcome.out == f"{out / 'step_80.csv'} is there already\n{out / 'step_50.csv'} is there already\n"
    assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == before


def test_a_second_run_writes_what_is_missing(fitted, simulated):
    out, _ = simulated
    content = (out / "step_50.csv").read_bytes()
    (out / "step_50.csv").unlink()
    outcome = run_command("simulate", fitted.study, "--out", out)
    assert outcome.out == f"{out / 'step_80.csv'} is there already\nwrote {out / 'step_50.csv'}\n"
    assert (out / "step_50.csv").read_bytes() == content


# -- parameters --------------------------------------------------------------------------------------------------------


def test_with_fitted_parameters_the_trace_is_met(fitted, simulated, small, tmp_path):
    small.write_text(small.read_text().partition("[parameters]")[0])
    outcome = run_command("simulate", small, "--parameters", fitted.out / "parameters.json", "--out", tmp_path / "out")
    assert outcome.status == 0
    given = vgtjax.load_trace(small.parent / "step_80.csv")
    remaining = np.std(given.x_d - columns(tmp_path / "out" / "step_80.csv")["x_d [m]"])
    reported = read(fitted.out / "summary.json")["traces"]["step_80"]["rmse"]["x_d"]
    assert remaining == pytest.approx(reported, rel=1e-3)  # nine digits of 10 mm are a thousandth of this rmse
    assert np.std(given.x_d - columns(simulated[0] / "step_80.csv")["x_d [m]"]) > 5 * reported


def test_a_folder_of_a_fit_without_units_will_do(fitted, small, tmp_path):
    outcome = run_command("simulate", small, "--parameters", fitted.out, "--out", tmp_path / "out")
    assert outcome.status == 0


def test_a_travel_without_end_is_null(fitted, small, tmp_path):
    content = read(fitted.out / "parameters.json")
    content["parameters"]["diaphragm.travel"]["value"] = None
    content["parameters"]["diaphragm.preload"]["value"] = 60.0  # N
    (tmp_path / "p.json").write_text(json.dumps(content))
    outcome = run_command("simulate", small, "--parameters", tmp_path / "p.json", "--out", tmp_path / "out")
    assert outcome.status == 0
    # The step ends short of the stop, so nothing changes.
    assert np.max(columns(tmp_path / "out" / "step_80.csv")["x_d [m]"]) < 10.13e-3


# -- studies -----------------------------------------------------------------------------------------------------------


def test_windows_names_and_notes(folder, tmp_path):
    cut_example("step_80", 1.2, folder, "bench")
    lines = (folder / "bench.csv").read_text().replace("p_res [mbar gauge]", "supply [V]")
    (folder / "bench.csv").write_text(lines)
    (folder / "study.toml").write_text('[[trace]]\nfile = "bench.csv"\nname = "cut"\nwindow = [0.2, 0.7]\n')
    outcome = run_command("simulate", folder / "study.toml", "--out", tmp_path / "out")
    assert outcome.out == (
        "note: cut: column 'supply' is not used\n"
        "note: cut: no column p_res; 20000 Pa absolute is assumed for the reservoir\n"
        f"wrote {tmp_path / 'out' / 'cut.csv'}\n"
    )
    time = columns(tmp_path / "out" / "cut.csv")["time [s]"]
    assert (time[0], time[-1], len(time)) == (0.2, 0.7, 501)


def test_a_drive_force_is_not_for_the_full_model(folder, tmp_path):
    (folder / "bench.csv").write_text((folder / "bench.csv").read_text().replace("p_res [mbar gauge]", "f_drive [N]"))
    outcome = run_command("simulate", folder / "study.toml", "--out", tmp_path / "out")
    assert outcome.status == 0
    assert "note: bench: column 'f_drive' is not used\n" in outcome.out


def test_the_mechanical_model_is_driven_by_a_force(folder, tmp_path):
    rows = [f"{i / 1000},{10.0 * i},{0.0}" for i in range(12)]
    (folder / "bench.csv").write_text("\n".join(["time [s],f_drive [N],x_d [mm]", *rows]) + "\n")
    (folder / "study.toml").write_text('model = "mechanical"\n[[trace]]\nfile = "bench.csv"\n')
    outcome = run_command("simulate", folder / "study.toml", "--out", tmp_path / "out")
    assert (outcome.status, outcome.err) == (0, "")
    written = columns(tmp_path / "out" / "bench.csv")
    assert list(written) == ["time [s]", "x_d [m]", "v_d [m/s]", "z [m]", "f_drive [N]"]
    np.testing.assert_allclose(written["f_drive [N]"], 10.0 * np.arange(12))


def test_the_sides_of_a_map_may_change_with_the_speed(folder, tmp_path):
    rows = [f"{i / 1000},{5.0 * i},0.0,3000.0" for i in range(40)]
    (folder / "bench.csv").write_text("\n".join(["time [s],f_drive [N],x_d [mm],p_trb [mbar gauge]", *rows]) + "\n")
    (folder / "study.toml").write_text(
        'model = "mechanical"\n[components]\nvane_force = "speed-map"\n[[trace]]\nfile = "bench.csv"\n[parameters]\n'
        '"vane_force.turbine_pressure" = {value = [3e5]}\n"vane_force.crank_angle" = {value = [4, 40]}\n'
        '"vane_force.closing" = {value = [4, 4]}\n"vane_force.opening" = {value = [-2, -2]}\n'
        '"vane_force.side_speed" = {value = 2e-4}\n'
    )
    outcome = run_command("simulate", folder / "study.toml", "--out", tmp_path / "out")
    assert (outcome.status, outcome.err) == (0, "")
    written = columns(tmp_path / "out" / "bench.csv")
    closed_form = 1 + 3 * np.tanh(written["v_d [m/s]"] / 2e-4)
    np.testing.assert_allclose(written["f_vane [N]"], closed_form, atol=1e-6)  # nine digits are written
    assert written["v_d [m/s]"][-1] > 0.02


def test_a_duty_that_is_late_leaves_times_and_duty_as_recorded(small, tmp_path):
    """It jumps between two of the times."""
    small.write_text(small.read_text().replace("[[trace]]\n", "[[trace]]\nduty_delay = 0.0025\n", 2))
    assert run_command("simulate", small, "--out", tmp_path / "out").status == 0
    for name in ("step_80", "step_50"):
        given, written = vgtjax.load_trace(small.parent / f"{name}.csv"), columns(tmp_path / "out" / f"{name}.csv")
        np.testing.assert_array_equal(written["time [s]"], given.time)
        np.testing.assert_array_equal(written["pwm [%]"], given.pwm)
    step = int(np.flatnonzero(np.diff(written["pwm [%]"]))[0]) + 1
    assert written["p_act [Pa absolute]"][step + 1] == written["p_act [Pa absolute]"][0]
    assert written["p_act [Pa absolute]"][step + 9] < written["p_act [Pa absolute]"][0]


def test_a_folder_whose_name_looks_like_a_pattern(folder, tmp_path):
    odd = folder / "bench [1]*"
    odd.mkdir()
    for name in ("study.toml", "bench.csv"):
        (folder / name).rename(odd / name)
    (odd / "study.toml").write_text('[[trace]]\nfile = "*.csv"\n')
    outcome = run_command("simulate", odd / "study.toml", "--out", tmp_path / "out [x]")
    assert outcome.status == 0
    assert outcome.out.endswith(f"wrote {tmp_path / 'out [x]' / 'bench.csv'}\n")


def test_a_file_whose_name_looks_like_a_pattern(folder, tmp_path):
    (folder / "bench.csv").rename(folder / "bench[80].csv")
    (folder / "study.toml").write_text('[[trace]]\nfile = "bench[80].csv"\n')
    assert run_command("simulate", folder / "study.toml", "--out", tmp_path / "out").status == 0
    assert (tmp_path / "out" / "bench[80].csv").exists()


def test_a_simulation_that_fails_says_which_and_keeps_the_others(small, tmp_path):
    # Far past its soft stop the diaphragm has swept its chamber twice, which is large enough for the travel.
    soft = '"chamber.volume" = {value = 7e-6}\n"diaphragm.stop_stiffness" = {value = 1e3}\n'
    soft += '"diaphragm.travel" = {value = 2e-3}\n'
    small.write_text(small.read_text() + soft)
    outcome = run_command("simulate", small, "--out", tmp_path / "out")
    assert outcome.status == 1
    assert outcome.err == (
        "failed: the simulation of trace 'step_80' failed: The simulation left the finite numbers: check that the "
        "parameters are physical, then lower max_step\n"
    )
    assert {path.name for path in (tmp_path / "out").iterdir()} == {".study.json", "step_50.csv"}


def write_two(folder, highest: float) -> None:
    """Two traces for the mechanical model; the sensor of the second shows no pressure above `highest`, mbar gauge."""
    noise = np.random.default_rng(0).normal(size=400)
    for name, most in (("a", np.inf), ("b", highest)):
        pressure = np.minimum(np.round(1.5 * noise - np.linspace(0, 300, 400).clip(60) + 60, 1), most)
        rows = [f"{i / 1000:.3f},{each:.1f},0.0" for i, each in enumerate(pressure)]
        (folder / f"{name}.csv").write_text("\n".join(["time [s],p_act [mbar gauge],x_d [mm]", *rows]) + "\n")


def test_a_pressure_that_can_not_drive_the_model_leaves_nothing_behind(folder, tmp_path):
    (folder / "study.toml").write_text('model = "mechanical"\n[[trace]]\nfile = "a.csv"\n[[trace]]\nfile = "b.csv"\n')
    write_two(folder, 0.0)
    outcome = run_command("simulate", folder / "study.toml", "--out", tmp_path / "out")
    assert (outcome.status, outcome.out) == (2, "")
    assert re.match(r"error: study\.toml: b: what drives this model must be valid .* with a window", outcome.err)
    assert not (tmp_path / "out").exists()
    write_two(folder, np.inf)
    assert run_command("simulate", folder / "study.toml", "--out", tmp_path / "out").status == 0


def test_a_folder_in_which_nothing_was_simulated_is_given_back(small, tmp_path):
    good, soft = small.read_text(), '"chamber.volume" = {value = 7e-6}\n"diaphragm.stop_stiffness" = {value = 1e3}\n'
    alone = good.replace('[[trace]]\nfile = "step_50.csv"\nuse = "validate"\natmosphere = 101100\n', "")
    small.write_text(f'{alone}{soft}"diaphragm.travel" = {{value = 2e-3}}\n')
    assert run_command("simulate", small, "--out", tmp_path / "out").status == 1
    assert list((tmp_path / "out").iterdir()) == []
    small.write_text(good)
    assert run_command("simulate", small, "--out", tmp_path / "out").status == 0
