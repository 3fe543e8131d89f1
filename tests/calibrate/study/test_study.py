"""Good studies: what they say is what is prepared."""

import json
import math
import pathlib

import numpy as np
import pytest
from bad_traces import text
from study_text import HEAD

import vgtjax
from calibrate.study.models import passivity_note
from calibrate.study.read import EXAMPLE, load_study
from calibrate.study.tables import AnyStudy
from calibrate.study.units import prepare

WHOLE = f"""{HEAD}
[[trace]]
file = "bench.csv"
use = "fit"
name = "first"
unit = "unit_a"
atmosphere = 101300
window = [0.002, 0.008]

[[trace]]
file = "unit_b_*.csv"
use = "validate"
unit = "{{stem:6}}"

[fit]
free = ["diaphragm.*", "friction.*"]
fixed = ["diaphragm.area"]

[parameters]
"diaphragm.stiffness" = {{value = 11500, lower = 8000, upper = 16000}}
"converter.atmosphere_orifice" = {{value = [1e-8, 1e-4, 0.3], lower = [0, 0, 0], upper = [inf, 1, 1]}}
"converter.magnetic_force[3]" = {{value = -4e-5, upper = 0}}
"""


def prepared(folder: pathlib.Path, study: str, parameters: pathlib.Path | None = None):
    (folder / "study.toml").write_text(study)
    return prepare(folder / "study.toml", parameters)


@pytest.fixture
def whole(folder):
    for name in ("unit_b_2", "unit_b_10"):
        (folder / f"{name}.csv").write_text(text())
    return prepared(folder, WHOLE)


def test_units_and_their_traces(whole):
    seen = {unit.name: [(use, trace.name) for use, trace in unit.traces] for unit in whole.units}
    assert seen == {"unit_a": [("fit", "first")], "unit_b": [("validate", "unit_b_10"), ("validate", "unit_b_2")]}


@pytest.mark.parametrize("first", ["vector", "entry"])
def test_an_entry_that_is_stated_by_itself_leaves_the_bounds_of_its_vector(folder, first):
    stated = {
        "vector": '"converter.atmosphere_orifice" = {lower = [0, -1, 0], upper = [1, 1, 2]}\n',
        "entry": '"converter.atmosphere_orifice[2]" = {value = 0.4, upper = 1.5}\n',
    }
    order = ["vector", "entry"] if first == "vector" else ["entry", "vector"]
    study = f'{HEAD}\n[[trace]]\nfile = "bench.csv"\n[parameters]\n' + "".join(stated[each] for each in order)
    bounds = prepared(folder, study).units[0].bounds
    assert bounds["converter.atmosphere_orifice[1]"] == (-1.0, 1.0)
    assert bounds["converter.atmosphere_orifice[2]"] == (0.0, 1.5)


@pytest.mark.parametrize(("window", "said"), [("[0.006, 0.011]", True), ("[0.009, 0.011]", False)])
def test_it_is_said_that_what_is_fitted_validates_nothing(folder, capsys, window, said):
    fitted = '[[trace]]\nfile = "bench.csv"\nwindow = [0.0, 0.008]\n'
    study = fitted + f'[[trace]]\nfile = "bench.csv"\nname = "rest"\nuse = "validate"\nwindow = {window}\n'
    (folder / "study.toml").write_text(study)
    prepare(folder / "study.toml", None, to_fit=True)
    assert ("note: rest: what is fitted as well of its samples" in capsys.readouterr().out) == said


def test_window_and_atmosphere_belong_to_their_trace(whole):
    (_, first), (_, other) = (unit.traces[0] for unit in whole.units)
    np.testing.assert_allclose(first.time, np.arange(2, 9) / 1000)
    assert (first.atmosphere, other.atmosphere) == (101300.0, 101013.0)
    assert first.p_res[0] - other.p_res[0] == pytest.approx(287.0)
    assert len(other.time) == 12


def test_start_values_and_bounds(whole):
    unit = whole.units[0]
    assert float(unit.model.diaphragm.stiffness) == 11500.0
    np.testing.assert_array_equal(unit.model.converter.atmosphere_orifice, [1e-8, 1e-4, 0.3])
    np.testing.assert_allclose(
        unit.model.converter.magnetic_force.coefficients, [0.021731, 0.0022634, 0.0039, -4e-5, 9.1355e-8]
    )
    assert unit.bounds == {
        "diaphragm.stiffness": (8000.0, 16000.0),
        "converter.atmosphere_orifice[0]": (0.0, None),
        "converter.atmosphere_orifice[1]": (0.0, 1.0),
        "converter.atmosphere_orifice[2]": (0.0, 1.0),
        "converter.magnetic_force[3]": (None, 0.0),
    }


def test_a_study_may_say_no_more_than_its_trace(folder):
    job = prepared(folder, '[[trace]]\nfile = "bench.csv"\n')
    (unit,) = job.units
    assert (job.study.name, job.study.model, unit.name, unit.bounds) == ("study", "full", None, {})
    assert [(use, trace.name) for use, trace in unit.traces] == [("fit", "bench")]
    assert (job.study.fit.free, job.study.fit.fixed) == (None, [])


def test_a_known_gain_of_a_sensor_is_taken_out(folder):
    line = '[[trace]]\nfile = "bench.csv"\n'
    plain = prepared(folder, line).units[0].traces[0][1]
    other = prepared(folder, line + "gain = {x_d = 1.25, p_act = 0.8}\n").units[0].traces[0][1]
    np.testing.assert_allclose(other.x_d, plain.x_d / 1.25, rtol=1e-12)
    np.testing.assert_allclose(other.p_act, plain.p_act / 0.8, rtol=1e-12)
    np.testing.assert_array_equal(other.pwm, plain.pwm)
    with pytest.raises(vgtjax.InputError, match="a gain of f_vane needs that column, but the trace has none"):
        prepared(folder, line + "gain = {f_vane = 1.1}\n")
    for nonsense in ("gain = {x_d = 0.0}", "gain = {pwm = 1.1}"):
        with pytest.raises(vgtjax.InputError, match="gain"):
            prepared(folder, line + nonsense + "\n")


def test_two_certificates_of_a_sensor_are_put_together():
    first = {"channel": "x_d", "uncertainty": 1e-6, "relative_uncertainty": 0.01}
    for second in ({"serial": "B"}, {"relative_uncertainty": 0.01}):
        sensors = [first, {"channel": "x_d", **second}, {"channel": "p_act", "uncertainty": 50.0}]
        report = AnyStudy.validate_python({"report": {"sensor": sensors}}).report
        assert report.offsets == {"x_d": 1e-6, "p_act": 50.0}
        assert report.gains == {"x_d": 0.01}


def test_a_byte_order_mark_is_no_part_of_a_study(folder):
    (folder / "study.toml").write_text('\ufeff[[trace]]\nfile = "bench.csv"\n', encoding="utf-8")
    assert prepare(folder / "study.toml", None).text.startswith("[[trace]]")


def test_traces_may_lie_elsewhere(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "below").mkdir()
    (elsewhere / "below" / "far.csv").write_text(text())
    job = prepared(
        folder, f'[[trace]]\nfile = "{elsewhere}/**/*.csv"\n[[trace]]\nfile = "../{folder.name}/bench.csv"\n'
    )
    assert [trace.name for _, trace in job.units[0].traces] == ["far", "bench"]


@pytest.mark.parametrize("unit", ["{stem:5}", "{stem}", "no_{stem:3}"])
def test_a_unit_may_be_made_of_the_stem(folder, unit):
    job = prepared(folder, f'[[trace]]\nfile = "*.csv"\nunit = "{unit}"\n')
    assert [u.name for u in job.units] == ["no_ben" if unit.startswith("no") else "bench"]


def test_the_same_name_may_be_used_in_two_units(folder):
    trace = '[[trace]]\nfile = "bench.csv"\nname = "step"\nunit = "{}"\n'
    assert len(prepared(folder, trace.format("a") + trace.format("b")).units) == 2


def test_a_longer_travel_lets_the_trace_go_further(folder):
    (folder / "bench.csv").write_text(text().replace("1.10", "12.10"))
    trace = '[[trace]]\nfile = "bench.csv"\n[parameters]\n"diaphragm.travel" = {'
    for travel in ("value = 0.0118", "upper = 0.0118", "value = inf"):
        assert prepared(folder, f"{trace}{travel}}}\n").units[0].traces[0][1].x_d[-1] == pytest.approx(12.1e-3)
    with pytest.raises(
        vgtjax.InputError, match=r"^bench\.csv, line 13, column x_d: 12\.1 \[mm\] is outside what sensor"
    ):
        prepared(folder, f"{trace}value = 0.0115}}\n")


def test_an_earlier_fit_goes_before_what_the_study_states_of_free_parameters(folder, capsys):
    """A stated value of these says where a fit began; one of what is held is a fact, whatever an earlier fit held."""
    parameters = {
        "chamber.volume": {"value": 5e-5},
        "diaphragm.mass": {"value": 0.5},
        "diaphragm.area": {"value": 2e-3},
    }
    (folder / "p.json").write_text(json.dumps({"model": "full", "parameters": parameters}))
    study = (
        '[[trace]]\nfile = "bench.csv"\n[parameters]\n"diaphragm.mass" = {value = 0.7, relative = 0.1, upper = 0.9}\n'
        '"diaphragm.area" = {value = 3e-3}\n'
    )
    (unit,) = prepared(folder, study, folder / "p.json").units
    found = (float(unit.model.chamber.volume), float(unit.model.diaphragm.mass), float(unit.model.diaphragm.area))
    assert found == (5e-5, 0.5, 3e-3)
    assert unit.bounds["diaphragm.mass"] == (None, 0.9)
    assert unit.known == ({"diaphragm.mass": pytest.approx(0.07)}, {"diaphragm.mass": 0.7})  # a prior stays where it is
    assert "\nnote: diaphragm.mass: as in the given parameters; what the study" in f"\n{capsys.readouterr().out}"


def test_of_a_vector_what_is_held_stays_as_stated(folder):
    stated, earlier = [1.0, 2.0, 3.0, 4.0, 5.0], [7.0, 8.0, 9.0, 10.0, 11.0]
    (folder / "p.json").write_text(
        json.dumps({"model": "full", "parameters": {"converter.magnetic_force": {"value": earlier}}})
    )
    study = '[[trace]]\nfile = "bench.csv"\n[fit]\nfree = ["converter.magnetic_force[2]"]\n[parameters]\n'
    for line, expected in (
        (f'"converter.magnetic_force" = {{value = {stated}}}', [1.0, 2.0, 9.0, 4.0, 5.0]),
        ('"converter.magnetic_force[0]" = {value = 1.0}', [1.0, *earlier[1:]]),
        ('"converter.magnetic_force[2]" = {value = 1.0}', earlier),
    ):
        (unit,) = prepared(folder, f"{study}{line}\n", folder / "p.json").units
        assert np.asarray(vgtjax.get_parameter(unit.model, "converter.magnetic_force")).tolist() == expected
    with pytest.raises(vgtjax.InputError, match="needs 5 numbers under value, but it has 2"):
        prepared(folder, f'{study}"converter.magnetic_force" = {{value = [1.0, 2.0]}}\n', folder / "p.json")


def test_an_earlier_fit_must_keep_to_the_bounds_too(folder):
    (folder / "p.json").write_text(json.dumps({"model": "full", "parameters": {"diaphragm.mass": {"value": 0.5}}}))
    study = '[[trace]]\nfile = "bench.csv"\n[parameters]\n"diaphragm.mass" = {lower = 0.6}\n'
    with pytest.raises(
        vgtjax.InputError, match=r"^'diaphragm\.mass' must be at least 0\.6, but it is 0\.5; change one"
    ):
        prepared(folder, study, folder / "p.json")


def test_an_endless_travel_in_parameters_is_null(folder):
    (folder / "p.json").write_text(json.dumps({"model": "full", "parameters": {"diaphragm.travel": {"value": None}}}))
    model = prepared(folder, '[[trace]]\nfile = "bench.csv"\n', folder / "p.json").units[0].model
    assert math.isinf(model.diaphragm.travel)


def test_the_fingerprint_sees_the_study_its_traces_and_the_parameters(folder):
    study = '[[trace]]\nfile = "bench.csv"\n'
    (folder / "p.json").write_text(json.dumps({"model": "full", "parameters": {"diaphragm.mass": {"value": 0.5}}}))
    seen = [
        prepared(folder, study),
        prepared(folder, f'name = "other"\n{study}'),
        prepared(folder, study, folder / "p.json"),
    ]
    (folder / "bench.csv").write_text(text().replace("0.10", "0.11"))
    seen.append(prepared(folder, study))
    assert len({job.fingerprint for job in seen}) == 4
    (folder / "bench.csv").write_text(text())
    assert prepared(folder, f"# a remark\n{study}").fingerprint == seen[0].fingerprint


def test_the_example_that_ships_is_a_good_study():
    job = prepare(None, None)
    assert job.text == EXAMPLE.read_text(encoding="utf-8")
    (unit,) = job.units
    assert {use for use, _ in unit.traces} == {"fit", "validate"}
    assert all(trace.notes == () for _, trace in unit.traces)


@pytest.mark.parametrize("path", sorted(EXAMPLE.parent.rglob("study.toml")), ids=lambda path: path.parent.name)
def test_examples_say_that_their_data_are_simulated(path):
    assert "simulated" in load_study(path).data


def test_friction_that_may_give_out_energy_is_said_by_how_much():
    """At its bound it is passive, as the warning of the library has it."""
    bound = float(vgtjax.LuGre().passivity_bound())
    assert passivity_note(vgtjax.Actuator(friction=vgtjax.LuGre(viscous_damping=bound))) is None
    with pytest.warns(vgtjax.PassivityWarning):
        below = vgtjax.LuGre(viscous_damping=bound - 0.0614)
    assert "must be 0.0614 N s/m larger" in passivity_note(vgtjax.Actuator(friction=below))
