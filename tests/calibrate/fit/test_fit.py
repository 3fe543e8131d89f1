"""What a fit writes, and that it is true."""

import dataclasses
import re

import numpy as np
import pytest
from commands import read, run_command

import vgtjax
from vgtjax.estimation import Progress

FIELDS = {"value", "unit", "free", "std_error", "initial", "lower", "upper", "at_bound", "identifiable"}
FREE = {"converter.magnetic_force[2]", "diaphragm.preload", "diaphragm.stiffness", "friction.viscous_damping"}


@pytest.fixture
def parameters(fitted):
    return read(fitted.out / "parameters.json")["parameters"]


@pytest.fixture
def summary(fitted):
    return read(fitted.out / "summary.json")


@pytest.fixture
def fitted_actuator(actuator, parameters):
    return vgtjax.replace_parameters(actuator, {name: fields["value"] for name, fields in parameters.items()})


def test_a_fit_ends_well_and_leaves_nothing_else_behind(fitted):
    assert (fitted.outcome.status, fitted.outcome.err) == (0, "")
    assert fitted.outcome.out.endswith(f"report: {fitted.out / 'report.html'}\n")
    assert {path.name for path in fitted.out.iterdir()} == {
        ".study.json",
        "parameters.json",
        "summary.json",
        "report.html",
    }


# -- parameters.json ---------------------------------------------------------------------------------------------------


def test_every_parameter_of_the_model_is_there_with_every_field(actuator, fitted, parameters):
    assert read(fitted.out / "parameters.json")["model"] == "full"
    table = vgtjax.parameter_table(actuator)
    assert list(parameters) == list(table)
    for name, fields in parameters.items():
        assert set(fields) == FIELDS
        size = table[name].size
        for field in fields.values():
            assert isinstance(field, list) == (size is not None)
            assert size is None or len(field) == size
        assert fields["unit"] == (table[name].unit if size is None else list(table[name].unit))


def entries(parameters):
    """Every scalar entry with its fields."""
    for name, fields in parameters.items():
        if isinstance(fields["value"], list):
            for i in range(len(fields["value"])):
                yield f"{name}[{i}]", {key: field[i] for key, field in fields.items()}
        else:
            yield name, fields


def test_free_and_held_entries_differ_as_they_should(parameters):
    assert {entry for entry, fields in entries(parameters) if fields["free"]} == FREE
    for entry, fields in entries(parameters):
        if entry in FREE:
            assert fields["value"] != fields["initial"]
            assert fields["std_error"] > 0
            assert fields["identifiable"] is True
        else:
            assert fields["value"] == fields["initial"]
            assert fields["std_error"] is None
        assert fields["at_bound"] is False


def test_start_values_and_bounds_are_those_of_the_study(actuator, parameters):
    for name, fields in parameters.items():
        printed = np.asarray(vgtjax.get_parameter(actuator, name)).tolist()
        stated = name == "diaphragm.stiffness"
        assert fields["initial"] == (11500.0 if stated else printed)
        bounds = (fields["lower"], fields["upper"])
        none = [None] * len(printed) if isinstance(printed, list) else None
        assert bounds == ((8000.0, 16000.0) if stated else (none, none))


def test_the_fit_found_the_actuator_of_the_example(parameters):
    # Fits of all traces find 11.9 kN/m and 50.4 N; 1.2 s of one step can't tell them to better than a few percent.
    assert parameters["diaphragm.stiffness"]["value"] == pytest.approx(11900, rel=0.05)
    assert parameters["diaphragm.preload"]["value"] == pytest.approx(50.4, rel=0.1)


# -- summary.json ------------------------------------------------------------------------------------------------------


def test_the_summary_says_how_it_went(summary):
    assert summary["converged"] is True
    assert 1 <= summary["iterations"] < 20
    assert 0 < summary["wall_seconds"] < 300
    assert {name: trace["use"] for name, trace in summary["traces"].items()} == {
        "step_80": "fit",
        "step_50": "validate",
    }


@pytest.mark.parametrize(("name", "atmosphere"), [("step_80", 101013.0), ("step_50", 101100.0)])
@pytest.mark.parametrize("channel", ["x_d", "p_act"])
def test_rmse_is_what_remains_after_the_offset(fitted, fitted_actuator, summary, name, atmosphere, channel):
    trace = vgtjax.load_trace(fitted.study.parent / f"{name}.csv", atmosphere=atmosphere)
    difference = getattr(trace, channel) - np.asarray(getattr(vgtjax.simulate(fitted_actuator, trace), channel))
    reported = summary["traces"][name]
    # One trace alone and many side by side round differently: 1e-12 of pressures near 1e5 Pa.
    assert reported["offset"][channel] == pytest.approx(np.mean(difference), rel=1e-6)
    assert reported["rmse"][channel] == pytest.approx(np.std(difference), rel=1e-6)


def test_the_fit_is_better_than_its_start(fitted, actuator, summary):
    trace = vgtjax.load_trace(fitted.study.parent / "step_80.csv")
    before = np.std(trace.x_d - np.asarray(vgtjax.simulate(actuator, trace).x_d))
    assert summary["traces"]["step_80"]["rmse"]["x_d"] < before / 5


# -- the same from Python ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def calibration(fitted):
    """The study of the command, as a user of the library writes it."""
    fit, validate = (
        vgtjax.load_trace(fitted.study.parent / f"{name}.csv", atmosphere=atmosphere)
        for name, atmosphere in (("step_80", 101013.0), ("step_50", 101100.0))
    )
    return vgtjax.fit(
        vgtjax.Actuator(),
        [fit],
        [validate],
        free=sorted(FREE),
        values={"diaphragm.stiffness": 11500.0},
        bounds={"diaphragm.stiffness": (8000.0, 16000.0)},
    )


def test_one_call_from_python_gives_the_same_answer(calibration, parameters, summary):
    found = dict(entries(parameters))
    for entry, value, error in zip(
        calibration.task.selection.entries, calibration.values, calibration.std_errors, strict=True
    ):
        assert (float(value), float(error)) == (found[entry]["value"], found[entry]["std_error"])
    assert calibration.progress.cost == summary["cost"]
    assert (calibration.converged, calibration.progress.iteration) == (True, summary["iterations"])
    assert calibration.verdict == summary["verdict"]


def test_a_calibration_prints_itself_as_a_table(calibration, parameters):
    head, *lines = repr(calibration).splitlines()
    assert head == (
        f"Calibration: converged after {calibration.progress.iteration} steps; {calibration.progress.verdict}"
    )
    rows = {line.split()[0]: line.split()[1:] for line in lines}
    stiffness = parameters["diaphragm.stiffness"]
    assert rows["diaphragm.stiffness"] == [f"{stiffness['value']:.6g}", f"{stiffness['std_error']:.2g}", "N/m", "free"]
    assert set(rows) == {"parameter", "trace", "step_80", "step_50", *FREE}
    assert rows["step_50"][0] == "validate"
    assert float(rows["step_80"][1]) == pytest.approx(calibration.traces[0].rmse["x_d"], rel=1e-2)
    assert len({line.index("free") for line in lines if line.endswith("free")}) == 1, "columns are aligned"


def test_a_notebook_shows_the_same_table(calibration):
    cells = re.findall(r"<t[dh]>(.*?)</t[dh]>", calibration._repr_html_())
    words = repr(calibration).partition("\n")[2].split()
    assert " ".join(cells).split() == words


def _failed(result):
    channel = result.channels["x_d"]
    lost = dataclasses.replace(channel, simulated=np.full_like(channel.simulated, np.nan))
    return dataclasses.replace(result, channels={**result.channels, "x_d": lost})


def test_what_is_wrong_with_a_fit_is_part_of_its_answer(calibration):
    """A value on its bound, one that the data don't tell, one that ran away, and a trace that failed."""
    far = dataclasses.replace(
        calibration,
        progress=dataclasses.replace(
            calibration.progress,
            coordinates=tuple(np.array(calibration.progress.coordinates) + np.array([0.0, 0.0, 0.0, 20.0])),
        ),
        values=calibration.values * np.exp([0.0, 0.0, 0.0, 20.0]),
        traces=[_failed(calibration.traces[0]), calibration.traces[1]],
        uncertainty=dataclasses.replace(
            calibration.uncertainty, determined=np.array([False, *calibration.uncertainty.determined[1:]])
        ),
    )
    assert far.task.selection.entries[3] == "friction.viscous_damping"
    assert far.ran_away == ("friction.viscous_damping",)
    assert not far.converged
    failed, away = far.troubles
    assert failed == "the simulation of step_80 with the fitted values left the finite numbers"
    assert away.startswith("fitted values must stay within a factor 100000 of their start values, but friction.viscous")
    assert far.verdict == f"{failed}; {away}"
    assert repr(far).startswith("Calibration: NOT converged after ")
    assert re.search(rf"{re.escape(far.task.selection.entries[0])} .* not determined", repr(far))


# -- what a fit must not depend on, and what it must respect -----------------------------------------------------------


def refit(study, *arguments):
    out = study.parent / "out"
    outcome = run_command("fit", study, "--out", out, *arguments)
    return outcome, read(out / "parameters.json")["parameters"], read(out / "summary.json")


def test_a_sensor_offset_changes_the_offset_and_nothing_else(small, parameters, summary):
    path = small.parent / "step_80.csv"
    header, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    shifted = [f"{t},{u},{float(p) + 20:.3f},{r},{float(x) + 0.2:.4f}" for t, u, p, r, x in cells]
    path.write_text("\n".join([header, *shifted]) + "\n")
    outcome, found, said = refit(small)
    assert outcome.status == 0
    for entry, fields in entries(found):
        # Residuals are the same but for rounding of the shifted cells; a fit stops within a thousandth of an error.
        expected = dict(entries(parameters))[entry]
        assert fields["value"] == pytest.approx(expected["value"], abs=1e-2 * (expected["std_error"] or 0.0), rel=1e-12)
    moved = {
        c: said["traces"]["step_80"]["offset"][c] - summary["traces"]["step_80"]["offset"][c] for c in ("x_d", "p_act")
    }
    assert moved["x_d"] == pytest.approx(0.2e-3, rel=1e-3)
    assert moved["p_act"] == pytest.approx(2000.0, rel=1e-3)


def test_a_fit_may_start_from_another(fitted, small, parameters, summary):
    outcome, found, said = refit(small, "--parameters", fitted.out / "parameters.json")
    assert outcome.status == 0
    assert said["iterations"] < summary["iterations"]
    for name, fields in found.items():
        stated = name == "diaphragm.stiffness"  # what the study says itself goes before an earlier fit
        assert fields["initial"] == (11500.0 if stated else parameters[name]["value"])


@pytest.mark.parametrize("upper", [16000.0, None])
def test_a_bound_holds_and_is_reported(small, upper):
    bounds = "lower = 13000" if upper is None else f"lower = 13000, upper = {upper}"
    small.write_text(
        small.read_text().replace("value = 11500, lower = 8000, upper = 16000", f"value = 13500, {bounds}")
    )
    outcome, found, _ = refit(small)
    assert outcome.status == 0
    stiffness = found["diaphragm.stiffness"]
    assert stiffness["value"] == pytest.approx(13000, rel=1e-12)
    assert stiffness["at_bound"] is True
    assert (stiffness["lower"], stiffness["upper"]) == (13000.0, upper)
    assert not found["diaphragm.preload"]["at_bound"]


def test_what_starts_at_zero_may_be_free(small):
    head, _, _ = small.read_text().partition("[fit]")
    small.write_text(f'{head}[fit]\nfree = ["diaphragm.*", "friction.*"]\nfixed = ["diaphragm.area"]\n')
    outcome, found, _ = refit(small)
    assert outcome.status == 0
    assert found["diaphragm.damping"]["initial"] == 0.0
    assert found["diaphragm.damping"]["value"] >= 0.0
    # Only their sum acts; a damping that its bound holds at zero leaves the other determined, or neither is.
    assert found["diaphragm.damping"]["free"]
    assert not found["diaphragm.damping"]["identifiable"]
    assert found["diaphragm.damping"]["at_bound"] or not found["friction.viscous_damping"]["identifiable"]


@pytest.mark.parametrize(("missing", "left"), [("x_d", "p_act"), ("p_act", "x_d")])
def test_one_measured_signal_is_enough(small, missing, left):
    for path in small.parent.glob("*.csv"):
        table = [line.split(",") for line in path.read_text().splitlines()]
        kept = [i for i, name in enumerate(table[0]) if not name.startswith(missing)]
        path.write_text("\n".join(",".join(row[i] for i in kept) for row in table) + "\n")
    outcome, _, said = refit(small)
    assert outcome.status == 0
    for trace in said["traces"].values():
        assert list(trace["rmse"]) == list(trace["offset"]) == [left]


# -- what the data can't tell ------------------------------------------------------------------------------------------

BLIND = """
[[trace]]
file = "step_80.csv"

[fit]
free = ["diaphragm.stiffness", "diaphragm.damping", "friction.viscous_damping", "converter.atmosphere_orifice"]

[parameters]
"diaphragm.damping" = {value = 10.0}
"""


@pytest.fixture(scope="module")
def blind(fitted, tmp_path_factory):
    """A fit of parameters of which the trace says nothing: only a sum of dampings, and an orifice that stays shut."""
    folder = tmp_path_factory.mktemp("blind")
    (folder / "step_80.csv").write_bytes((fitted.study.parent / "step_80.csv").read_bytes())
    (folder / "study.toml").write_text(BLIND)
    return refit(folder / "study.toml")


def test_what_the_data_do_not_see_is_marked(blind):
    outcome, found, _ = blind
    assert outcome.status == 0
    assert "warning: these traces do not determine converter.atmosphere_orifice[0], " in outcome.out
    for name in ("diaphragm.damping", "friction.viscous_damping"):
        assert (found[name]["free"], found[name]["identifiable"], found[name]["std_error"]) == (True, False, None)
    assert found["converter.atmosphere_orifice"]["identifiable"] == [False] * 3
    assert found["converter.atmosphere_orifice"]["std_error"] == [None] * 3
    assert found["converter.atmosphere_orifice"]["free"] == [True] * 3
    assert found["diaphragm.stiffness"]["identifiable"] is True
    assert found["diaphragm.stiffness"]["std_error"] > 0


def test_what_the_data_do_not_see_stays_where_it_was(blind):
    orifice = blind[1]["converter.atmosphere_orifice"]
    assert orifice["value"] == pytest.approx(orifice["initial"], rel=1e-9)


# -- the mechanical model ----------------------------------------------------------------------------------------------


MECHANICAL = """
model = "mechanical"

[[trace]]
file = "step_80.csv"

[fit]
free = ["diaphragm.stiffness", "diaphragm.preload"]
"""


def test_the_mechanical_model_fits_position_alone(small):
    small.write_text(MECHANICAL)
    outcome, found, said = refit(small)
    assert outcome.status == 0
    assert read(small.parent / "out" / "parameters.json")["model"] == "mechanical"
    assert not any(name.startswith(("converter", "chamber")) for name in found)
    assert set(said["traces"]["step_80"]["rmse"]) == {"x_d"}
    assert said["traces"]["step_80"]["rmse"]["x_d"] < 1.1 * said["traces"]["step_80"]["noise"]["x_d"]


# -- failures ----------------------------------------------------------------------------------------------------------


def test_a_fit_that_does_not_converge_says_so_and_keeps_what_it_has(small, monkeypatch):
    monkeypatch.setattr("vgtjax.estimation._fit.MAX_ITERATIONS", 1)
    outcome, _, said = refit(small)
    assert (outcome.status, outcome.err) == (1, "failed: the fit: not converged after 1 iterations\n")
    assert (said["converged"], said["iterations"]) == (False, 1)
    assert "NOT converged" in (small.parent / "out" / "report.html").read_text()
    again = run_command("fit", small, "--out", small.parent / "out")
    assert (again.status, again.err) == (outcome.status, outcome.err)
    assert again.out.startswith("nothing to do")


def test_a_fit_that_ran_away_did_not_converge(small, monkeypatch):
    """Nothing moves a rod of 1e88 kg: there every step gains nothing, which looks like the end of a fit."""
    small.write_text(MECHANICAL.replace('"diaphragm.stiffness", "diaphragm.preload"', '"diaphragm.mass"'))
    end = Progress(coordinates=(88 * float(np.log(10)),), converged=True, history=(7.0,))
    monkeypatch.setattr("vgtjax.identification._fit.better_start", lambda task: end)
    outcome, found, said = refit(small)
    sentence = (
        "fitted values must stay within a factor 100000 of their start values, but diaphragm.mass ended at 1e+88 kg "
        "(start 0.63); give bounds or better start values"
    )
    assert (outcome.status, outcome.err) == (1, f"failed: the fit: {sentence}\n")
    assert (said["converged"], said["error"]) == (False, sentence)
    assert found["diaphragm.mass"]["value"] == pytest.approx(1e88)
    assert (small.parent / "out" / "report.html").exists()


def test_a_start_that_cannot_be_simulated(small):
    small.write_text(small.read_text() + '"chamber.volume" = {value = 1e-6}\n')
    outcome = run_command("fit", small, "--out", small.parent / "out")
    assert outcome.status == 1
    assert outcome.err.startswith(
        "failed: the fit: the simulation with the start values fails, so there is nothing to fit"
    )
    said = read(small.parent / "out" / "summary.json")
    assert said["converged"] is False
    assert said["error"] in outcome.err
    assert said["traces"] == {}
    assert not (small.parent / "out" / "parameters.json").exists()


def test_a_validation_that_cannot_be_simulated(small):
    # At the end of this step the diaphragm takes more than the whole volume of so small a chamber.
    study = small.read_text().replace('"step_80.csv"', '"swap"').replace('"step_50.csv"', '"step_80.csv"')
    small.write_text(study.replace('"swap"', '"step_50.csv"') + '"chamber.volume" = {value = 2.2e-5}\n')
    outcome, _, said = refit(small)
    sentence = "the simulation of step_80 with the fitted values left the finite numbers"
    assert (outcome.status, outcome.err) == (1, f"failed: the fit: {sentence}\n")
    assert said["traces"]["step_80"]["rmse"] == {"x_d": None, "p_act": None}
    assert said["traces"]["step_50"]["rmse"]["x_d"] > 0
