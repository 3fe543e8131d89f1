"""What a fit must not depend on, what it respects, what it can't know, and how it fails."""

import numpy as np
import pytest
from commands import NOTHING_ELSE, UNSEEN, entries_of, read, run_command

import vgtjax
from vgtjax.assurance import _certificate
from vgtjax.estimation import Progress

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
    for entry, fields in entries_of(found).items():
        # Residuals are the same but for rounding of the shifted cells; a fit stops within a thousandth of an error.
        expected = entries_of(parameters)[entry]
        assert fields["value"] == pytest.approx(expected["value"], abs=1e-2 * (expected["std_error"] or 0.0), rel=1e-12)
    moved = {
        c: said["traces"]["step_80"]["offset"][c] - summary["traces"]["step_80"]["offset"][c] for c in ("x_d", "p_act")
    }
    assert moved["x_d"] == pytest.approx(0.2e-3, rel=1e-3)
    assert moved["p_act"] == pytest.approx(2000.0, rel=1e-3)


def test_a_fit_may_start_from_another(fitted, small, parameters, summary):
    outcome, found, said = refit(small, "--parameters", fitted.out / "parameters.json")
    assert outcome.status == 0
    steps = [each["iterations"] - each["corrections"]["count"] for each in (said, summary)]
    assert steps[0] <= steps[1]
    for name, fields in found.items():  # the stiffness as well, of which the study says where the earlier fit began
        assert fields["initial"] == parameters[name]["value"]
    assert "as in the given parameters" not in outcome.out


@pytest.mark.parametrize("upper", [16000.0, None])
def test_a_bound_holds_and_is_reported(plain, upper):
    bounds = "lower = 13000" if upper is None else f"lower = 13000, upper = {upper}"
    plain.write_text(
        plain.read_text().replace("value = 11500, lower = 8000, upper = 16000", f"value = 13500, {bounds}")
    )
    outcome, found, _ = refit(plain)
    assert outcome.status == 0
    stiffness = found["diaphragm.stiffness"]
    assert stiffness["value"] == pytest.approx(13000, rel=1e-12)
    assert stiffness["at_bound"] is True
    assert (stiffness["lower"], stiffness["upper"]) == (13000.0, upper)
    assert not found["diaphragm.preload"]["at_bound"]


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

BLIND = f"""
[[trace]]
file = "step_80.csv"

[fit]
free = {UNSEEN}

[parameters]
"diaphragm.damping" = {{value = 10.0}}
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


def test_what_starts_at_zero_may_be_free(small):
    small.write_text(BLIND.partition("[parameters]")[0])
    outcome, found, _ = refit(small)
    assert outcome.status == 0
    assert found["diaphragm.damping"]["initial"] == 0.0
    assert found["diaphragm.damping"]["value"] >= 0.0
    # Only their sum acts; a damping that its bound holds at zero leaves the other determined, or neither is.
    assert found["diaphragm.damping"]["free"]
    assert not found["diaphragm.damping"]["identifiable"]
    assert found["diaphragm.damping"]["at_bound"] or not found["friction.viscous_damping"]["identifiable"]


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


def test_a_fit_that_does_not_converge_says_so_and_keeps_what_it_has(plain, monkeypatch):
    monkeypatch.setattr("vgtjax.estimation.search._progress.MAX_ITERATIONS", 1)
    outcome, _, said = refit(plain)
    assert (outcome.status, outcome.err) == (1, "failed: the fit: not converged after 1 iterations\n")
    assert (said["converged"], said["iterations"]) == (False, 1)
    assert "NOT converged" in (plain.parent / "out" / "report.html").read_text()
    again = run_command("fit", plain, "--out", plain.parent / "out")
    assert (again.status, again.err) == (outcome.status, outcome.err)
    assert again.out.startswith("nothing to do")


def test_a_fit_that_ran_away_is_brought_back(small, monkeypatch):
    """Nothing moves a rod in oil of 1e88 N s/m: there every step gains nothing, which looks like the end of a fit. From
    its start the damping is found, as the traces tell of it."""
    small.write_text(MECHANICAL.replace('"diaphragm.preload"', '"friction.viscous_damping"') + NOTHING_ELSE)
    stiffness = float(np.log(vgtjax.Actuator().diaphragm.stiffness))
    end = Progress(coordinates=(stiffness, 88 * float(np.log(10))), converged=True, history=(7.0,))
    monkeypatch.setattr("vgtjax.identification._fit.better_start", lambda task: end)
    outcome, found, said = refit(small)
    assert (outcome.status, outcome.err, said["converged"]) == (0, "", True)
    damping = found["friction.viscous_damping"]
    assert damping["identifiable"]
    monkeypatch.undo()
    assert run_command("fit", small, "--out", small.parent / "plain").status == 0
    plain = read(small.parent / "plain" / "parameters.json")["parameters"]["friction.viscous_damping"]
    assert damping["value"] == pytest.approx(plain["value"], abs=0.1 * plain["std_error"])  # both stop near the minimum


SOFT_STOP = '"diaphragm.travel" = {value = 2e-3}\n"diaphragm.stop_stiffness" = {value = 1e3}\n"chamber.volume" = '
"""Past its soft stop the diaphragm sweeps so small a chamber twice, which is larger than what the travel sweeps."""


def test_a_start_that_cannot_be_simulated(small):
    small.write_text(f"{small.read_text()}{SOFT_STOP}{{value = 7e-6}}\n")
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


def test_a_validation_that_cannot_be_simulated(plain):
    # At the end of a step to 80 % the diaphragm has gone too far, of one to 50 % not.
    study = plain.read_text().replace('"step_80.csv"', '"swap"').replace('"step_50.csv"', '"step_80.csv"')
    plain.write_text(study.replace('"swap"', '"step_50.csv"') + SOFT_STOP + "{value = 8.5e-6}\n")
    outcome, _, said = refit(plain)
    sentence = "the simulation of step_80 with the fitted values failed: The simulation left the finite numbers: check"
    assert outcome.status == 1
    assert outcome.err.startswith(f"failed: the fit: {sentence}")
    assert said["traces"]["step_80"]["rmse"] == {"x_d": None, "p_act": None}
    assert said["traces"]["step_50"]["rmse"]["x_d"] > 0


@pytest.mark.parametrize(
    ("factor", "kind", "said_of_it"),
    [
        (2.0, "wrong_columns", "off by 50 %"),
        (0.0, "wrong_columns", "off by 100 %"),
        (np.nan, "exploded_columns", "no number"),
    ],
)
def test_a_fit_with_wrong_derivatives_fails_its_certificate(plain, monkeypatch, factor, kind, said_of_it):
    """The last derivatives are spoilt after the search; the run ends with status 1 and says which."""
    usual = _certificate.certifying

    def spoil(calibrator):
        columns = calibrator.minimiser.point.columns
        columns[:, calibrator.task.selection.entries.index("diaphragm.preload")] *= factor
        return usual(calibrator)

    monkeypatch.setattr(_certificate, "certifying", spoil)
    outcome, parameters, said = refit(plain)
    sentence = f"the gradient certificate failed: the derivative with respect to diaphragm.preload is {said_of_it}"
    assert (outcome.status, outcome.err) == (1, f"failed: the fit: {sentence}\n")
    assert not said["certificate"]["passed"]
    assert list(said["certificate"][kind]) == ["diaphragm.preload"]
    assert not any(np.any(each["identifiable"]) for each in parameters.values())
    assert f"verdict: NOT to be used: {sentence}" in outcome.out
    page = (plain.parent / "out" / "report.html").read_text()
    assert f"{sentence.capitalize()}. No value or error below may be used." in page
