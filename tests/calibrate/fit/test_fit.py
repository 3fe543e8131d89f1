"""What a fit writes, and that it is true."""

import dataclasses
import html
import re

import numpy as np
import pytest
from commands import entries_of, read

import vgtjax
from vgtjax.assurance import certified_fit
from vgtjax.estimation import found_besides
from vgtjax.traces import STANDARD_ATMOSPHERE

FIELDS = {"value", "unit", "free", "std_error", "interval", "initial", "lower", "upper", "at_bound", "identifiable"}
FREE = {"converter.magnetic_force[2]", "diaphragm.preload", "diaphragm.stiffness", "friction.viscous_damping"}


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
        for field in (fields[key] for key in FIELDS - {"interval"}):
            assert isinstance(field, list) == (size is not None)
            assert size is None or len(field) == size
        assert fields["unit"] == (table[name].unit if size is None else list(table[name].unit))


def test_free_and_held_entries_differ_as_they_should(parameters):
    assert {entry for entry, fields in entries_of(parameters).items() if fields["free"]} == FREE
    for entry, fields in entries_of(parameters).items():
        if entry in FREE:
            assert fields["value"] != fields["initial"]
            assert fields["std_error"] > 0
            assert fields["identifiable"] is True
            low, high = fields["interval"]
            assert low < fields["value"] < high
            # 1.96 standard errors on either side; of a positive value by its logarithm.
            assert high - low == pytest.approx(2 * 1.96 * fields["std_error"], rel=0.05)
        else:
            assert fields["value"] == fields["initial"]
            assert fields["std_error"] is None
            assert fields["interval"] is None
        assert fields["at_bound"] is False


def test_the_library_finds_the_same(actuator, fitted, parameters, kept):
    """Same values, errors, intervals and certificate by one call; programs are those of the command."""
    fitted_to, validated = (
        vgtjax.load_trace(fitted.study.parent / f"{name}.csv", atmosphere=atmosphere)
        for name, atmosphere in (("step_80", STANDARD_ATMOSPHERE), ("step_50", 101100.0))
    )
    bounds = {"diaphragm.stiffness": (8000.0, 16000.0)}
    begun = {"values": {"diaphragm.stiffness": 11500.0}, "free": sorted(FREE), "bounds": bounds}
    found = certified_fit(actuator, [fitted_to], [validated], **begun)
    assert found.usable
    entries = entries_of(parameters)
    for name, estimate in found.estimates.items():
        for field in ("value", "std_error", "interval"):
            # Bits: the sums are the same, in one process or another.
            np.testing.assert_allclose(getattr(estimate, field), entries[name][field], rtol=1e-9)
    assert found["diaphragm.stiffness"] == found.estimates["diaphragm.stiffness"]
    assert found.certificate.summary().items() <= read(fitted.out / "summary.json")["certificate"].items()
    title, head, *rows = repr(found).splitlines()
    assert title.startswith("Certified fit: usable")
    assert head.split()[:2] == ["parameter", "value"]
    assert rows[0].split()[0] == next(iter(found.estimates))
    assert found.certificate.sentence in rows


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


def test_the_summary_has_a_slice_of_every_direction(summary):
    assert [each["direction"] for each in summary["slices"]] == list(range(len(FREE)))
    for each in summary["slices"]:
        assert set(each["loadings"]) <= {*FREE, "duty_delay"}
        assert len(each["values"]) == len(each["reaches"])
        if each["verdict"] == "parabola":
            assert all(2.5 < value < 6.5 for value in each["values"])  # 4, and errors that are right to a quarter
    assert summary["not_looked_at"] == {"slices": 0, "profiles": []}


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


def test_one_call_from_python_gives_the_same_answer(calibration, parameters, summary):
    found = dict(entries_of(parameters).items())
    for entry, value, error in zip(
        calibration.task.selection.entries, calibration.values, calibration.std_errors, strict=True
    ):
        assert (float(value), float(error)) == (found[entry]["value"], found[entry]["std_error"])
    assert calibration.progress.cost == summary["cost"]
    assert (calibration.converged, calibration.progress.iteration) == (True, summary["iterations"])
    assert calibration.verdict == summary["verdict"]


def test_it_says_what_the_command_says_it_found(calibration, summary):
    *besides, met = calibration.findings
    assert besides == summary["found"][: len(besides)] == found_besides(calibration)
    assert summary["sentence"].endswith(met)


def test_a_calibration_prints_itself_as_a_table(calibration, parameters):
    head, *lines, exact = repr(calibration).splitlines()
    found = list(calibration.findings)
    lines, sentences = lines[: -len(found)], lines[-len(found) :]
    assert sentences == found
    assert head == (
        f"Calibration: converged after {calibration.progress.iteration} steps; {calibration.progress.verdict}"
    )
    assert exact.startswith("all errors take the values held of converter.plunger_mass, converter.actuator_area, ")
    assert exact.endswith("say how well these are known (deviations, gains)")
    rows = {line.split()[0]: line.split()[1:] for line in lines}
    stiffness = parameters["diaphragm.stiffness"]
    assert rows["diaphragm.stiffness"] == [f"{stiffness['value']:.6g}", f"{stiffness['std_error']:.2g}", "N/m", "free"]
    assert set(rows) == {"parameter", "trace", "step_80", "step_50", *FREE}
    assert rows["step_50"][0] == "validate"
    assert float(rows["step_80"][1]) == pytest.approx(calibration.traces[0].rmse["x_d"], rel=1e-2)
    assert len({line.index("free") for line in lines if line.endswith("free")}) == 1, "columns are aligned"


def test_a_notebook_shows_the_same_table(calibration):
    title, *shown = re.findall(r"<(?:td|th|p)>(.*?)</(?:td|th|p)>", calibration._repr_html_())
    words = repr(calibration).partition("\n")
    assert title == words[0]
    assert html.unescape(" ".join(shown)).split() == words[2].split()


def _failed(result):
    channel = result.channels["x_d"]
    lost = dataclasses.replace(channel, simulated=np.full_like(channel.simulated, np.nan))
    channels = {**result.channels, "x_d": lost}
    return dataclasses.replace(result, channels=channels, result=vgtjax.RESULTS.max_steps_reached)


def test_what_is_wrong_with_a_fit_is_part_of_its_answer(calibration):
    """A value on its bound, one that the data don't tell, one that ran away, and a trace that failed."""
    far = dataclasses.replace(
        calibration,
        progress=dataclasses.replace(
            calibration.progress,
            coordinates=tuple(np.array(calibration.progress.coordinates) + np.array([0.0, 0.0, 0.0, 20.0, 0.0])),
        ),
        values=calibration.values * np.exp([0.0, 0.0, 0.0, 20.0]),
        traces=[_failed(calibration.traces[0]), calibration.traces[1]],
        uncertainty=dataclasses.replace(
            calibration.uncertainty, estimable=np.array([False, *calibration.uncertainty.estimable[1:]])
        ),
    )
    assert far.task.selection.entries[3] == "friction.viscous_damping"
    assert far.ran_away == ("friction.viscous_damping",)
    assert not far.converged
    failed, away = far.troubles
    assert failed == (
        "the simulation of step_80 with the fitted values failed: The solver took max_steps steps before the end: "
        "raise max_steps, or loosen rtol and atol"
    )
    assert away.startswith("fitted values must stay within a factor 100000 of their start values, but friction.viscous")
    assert far.verdict == f"{failed}; {away}"
    assert repr(far).startswith("Calibration: NOT converged after ")
    assert re.search(rf"{re.escape(far.task.selection.entries[0])} .* not determined", repr(far))
