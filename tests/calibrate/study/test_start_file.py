"""`--parameters` takes a `parameters.json` of any version, CDFX and DCM: the same numbers are the same model."""

import json
import pathlib

import jax
import numpy as np
import pytest
from commands import assert_refused, read, run_command
from support import EXAMPLE

import vgtjax
from calibrate.study.models import build_model, start_model, values_of
from calibrate.study.parameter_file import tabulate, to_json
from calibrate.study.start_file import beside, load_duties, load_model, load_values, read_parameters
from calibrate.study.tables import AnyStudy
from calibrate.study.units import prepare
from vgtjax.estimation import FoundDuty

FLEET_UNIT = EXAMPLE / "fleet" / "units" / "unit_01" / "parameters.json"
KINDS = ("cdfx", "dcm")


@pytest.fixture(scope="module")
def data_sets(tmp_path_factory) -> dict[str, pathlib.Path]:
    """A unit of the fleet in every format that can be read."""
    folder = tmp_path_factory.mktemp("data_sets")
    files = {kind: folder / f"unit.{kind}" for kind in KINDS}
    for kind, path in files.items():
        assert run_command("export", FLEET_UNIT, "--format", kind, "--out", path).status == 0
    return files


def model(path):
    return load_model(*read_parameters(path))[1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_data_set_is_the_model_that_was_exported(data_sets, kind):
    leaves, structure = jax.tree.flatten(model(data_sets[kind]))
    expected, its_structure = jax.tree.flatten(model(FLEET_UNIT))
    assert structure == its_structure
    assert all(np.array_equal(leaf, other) for leaf, other in zip(leaves, expected, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_a_command_starts_from_it(fitted, tmp_path, kind):
    data_set = tmp_path / f"fit.{kind}"
    run_command("export", fitted.out, "--format", kind, "--out", data_set)
    for given, out in ((fitted.out / "parameters.json", "json"), (data_set, kind)):
        outcome = run_command("simulate", fitted.study, "--parameters", given, "--out", tmp_path / out)
        assert (outcome.status, outcome.err, "says nothing of" in outcome.out) == (0, "", False)
        # The file of a fit says that this began where the study does; a data set does not.
        assert ("note: diaphragm.stiffness: as in the given" in outcome.out) == (out == kind)
    first, second = ((tmp_path / out / "step_80.csv").read_bytes() for out in ("json", kind))
    assert first == second


@pytest.mark.parametrize(
    ("name", "components"),
    [
        ("mechanical", {"friction": "adaptive-lugre"}),
        ("plunger-map", {"vane_force": "polynomial"}),
        ("static-map", {"flow_map": "polynomial"}),
        ("full", {"friction": "dahl", "line": "wave", "magnetic_force": "coil", "chamber": "wall"}),
    ],
)
def test_every_model_comes_back(tmp_path, name, components):
    study = AnyStudy.validate_python({"model": name, "components": components})
    given = build_model(study)
    content = to_json(study, tabulate(given, given, {}, {}))
    (tmp_path / "parameters.json").write_text(json.dumps(content))
    assert run_command("export", tmp_path, "--format", "cdfx", "--out", tmp_path / "p.cdfx").status == 0
    leaves, expected = jax.tree.leaves(model(tmp_path / "p.cdfx")), jax.tree.leaves(given)
    assert len(leaves) == len(expected)
    assert all(np.array_equal(leaf, other) for leaf, other in zip(leaves, expected, strict=True))


def test_a_travel_without_end_comes_back(data_sets, tmp_path):
    content = read(FLEET_UNIT)
    content["parameters"]["diaphragm.travel"]["value"] = None
    endless = tmp_path / "p.json"
    endless.write_text(json.dumps(content))
    for kind in KINDS:
        path = tmp_path / f"endless.{kind}"
        assert run_command("export", endless, "--format", kind, "--out", path).status == 0
        assert model(path).diaphragm.travel == np.inf


def test_the_first_version_is_read_as_todays(tmp_path):
    old = read(FLEET_UNIT)
    del old["schema"], old["nuisance"]
    for fields in old["parameters"].values():
        del fields["interval"]
    (tmp_path / "old.json").write_text(json.dumps(old))
    path, content = read_parameters(tmp_path / "old.json")
    assert content["schema"] == 2
    assert content["parameters"]["diaphragm.mass"]["interval"] is None
    assert content["parameters"]["vane_force.closing"]["interval"] == [None] * 12
    assert content["nuisance"] == load_duties(path, None) == {}
    leaves, expected = jax.tree.leaves(model(path)), jax.tree.leaves(model(FLEET_UNIT))
    assert all(np.array_equal(leaf, other) for leaf, other in zip(leaves, expected, strict=True))


# -- parts of a data set -----------------------------------------------------------------------------------------------

HEAD = "KONSERVIERUNG_FORMAT 2.0\n"
PRELOAD = 'FESTWERT diaphragm__preload\n EINHEIT_W "N"\n WERT 51.5\nEND\n'
FORCE = 'FESTWERT converter__magnetic_force__2\n EINHEIT_W "N/%^2"\n WERT 0.004\nEND\n'


def test_what_a_file_leaves_out_keeps_its_value(folder, capsys):
    """Also entries of a vector of which others are given."""
    (folder / "some.dcm").write_text(HEAD + PRELOAD + FORCE)
    model = prepare(folder / "study.toml", folder / "some.dcm").units[0].model
    values = {"diaphragm.preload": 51.5, "converter.magnetic_force[2]": 0.004}
    names = [*values, "converter.magnetic_force[1]", "diaphragm.mass"]
    printed = vgtjax.Selection(tuple(names[2:])).pack(vgtjax.Actuator())
    np.testing.assert_array_equal(vgtjax.Selection(tuple(names)).pack(model), [*values.values(), *printed])
    assert capsys.readouterr().out == (
        "note: some.dcm says nothing of converter.plunger_mass, converter.membrane_stiffness, "
        "converter.return_spring_stiffness, converter.plunger_damping, converter.actuator_area, "
        "converter.atmosphere_area and 22 more: they keep their values\n"
    )


def cdfx(inside: str, model: str = "") -> str:
    tree = f"<SW-INSTANCE-TREE><LONG-NAME>{model}</LONG-NAME>{inside}</SW-INSTANCE-TREE>"
    return f"<MSRSW><SW-SYSTEMS><SW-SYSTEM><SW-INSTANCE-SPEC>{tree}</SW-INSTANCE-SPEC></SW-SYSTEM></SW-SYSTEMS></MSRSW>"


def instance(name: str, values: str, unit: str = "N", category: str = "VALUE") -> str:
    container = f"<UNIT-DISPLAY-NAME>{unit}</UNIT-DISPLAY-NAME><SW-VALUES-PHYS>{values}</SW-VALUES-PHYS>"
    head = f"<SHORT-NAME>{name}</SHORT-NAME><CATEGORY>{category}</CATEGORY>"
    return f"<SW-INSTANCE>{head}<SW-VALUE-CONT>{container}</SW-VALUE-CONT></SW-INSTANCE>"


BAD = {
    "another unit": (
        "p.dcm",
        HEAD + PRELOAD.replace('"N"', '"kN"'),
        "the unit of 'diaphragm.preload' must be 'N', but it is 'kN'; convert its value",
    ),
    "another unit of an entry": (
        "p.cdfx",
        cdfx(instance("converter__magnetic_force__2", "<V>0.004</V>", "N/%")),
        "the unit of 'converter.magnetic_force[2]' must be 'N/%^2', but it is 'N/%'; convert its value",
    ),
    "an unknown name": (
        "p.dcm",
        HEAD + PRELOAD.replace("preload", "preloat"),
        "parameter 'diaphragm.preloat' matches nothing; did you mean 'diaphragm.preload'?",
    ),
    "another model": (
        "p.dcm",
        HEAD + 'FUNKTIONEN\n FKT a "1" "model=mechanical friction=lugre"\nEND\n' + PRELOAD,
        "these are parameters of the model 'mechanical', but the study's is 'full'; give parameters of the same model",
    ),
    "other components": (
        "p.cdfx",
        cdfx(instance("diaphragm__preload", "<V>51.5</V>"), "model=full friction=dahl"),
        "these are parameters of a model with other components than the study's; give parameters of the same "
        "components",
    ),
    "a text": (
        "p.cdfx",
        cdfx(instance("diaphragm__preload", "<VT>much</VT>")),
        "the value of 'diaphragm__preload' must be a number, but it is 'much'; correct it",
    ),
    "two values": (
        "p.cdfx",
        cdfx(instance("diaphragm__preload", "<V>1</V><V>2</V>")),
        "'diaphragm__preload' must have one value, but it has 2; correct it",
    ),
    "too few values": (
        "p.cdfx",
        cdfx(instance("converter__magnetic_force", "<V>1</V><V>2</V>", category="VAL_BLK")),
        "'converter.magnetic_force' needs 5 numbers under value, but it has 2; give a list of 5",
    ),
    "a name twice": ("p.dcm", HEAD + PRELOAD + PRELOAD, "'diaphragm__preload' occurs twice; remove one of them"),
    "no end": ("p.dcm", HEAD + PRELOAD.replace("END\n", ""), "'FESTWERT diaphragm__preload' has no END; add it"),
    "a line": (
        "p.dcm",
        f"{HEAD}KENNLINIE a 2\nEND\n",
        "line 2: no parameter is a KENNLINIE; remove 'KENNLINIE a 2'",
    ),
    "no DCM": ("p.dcm", "hello\n", "a DCM file begins with KONSERVIERUNG_FORMAT, but this does not; give a DCM file"),
    "no CDFX": ("p.cdfx", "<a/>", "a CDFX file begins with MSRSW, but this has a; give a CDFX file"),
    "no XML": (
        "p.cdfx",
        "<MSRSW>",
        "this is not valid XML (no element found: line 1, column 7); write it again",
    ),
    "no values": (
        "p.cdfx",
        cdfx("<SW-INSTANCE><SHORT-NAME>a</SHORT-NAME><CATEGORY>VALUE</CATEGORY></SW-INSTANCE>"),
        "'a' has no SW-VALUES-PHYS; write physical values",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_data_set_that_can_not_be_taken(folder, fit, case):
    name, text, sentence = BAD[case]
    (folder / name).write_text(text)
    mark = "," if sentence.startswith("line ") else ":"
    assert_refused(fit("--parameters", folder / name), f"{name}{mark} {sentence}", folder / "out")


def test_a_knot_that_an_entry_takes_out_of_order(folder, fit):
    (folder / "p.cdfx").write_text(cdfx(instance("vane_force__crank_angle__0", "<V>40</V>", "deg")))
    with (folder / "study.toml").open("a") as study:
        study.write('[components]\nvane_force = "map"\n')
    sentence = (
        "p.cdfx: vane_force.crank_angle must be at least two knots that increase, in deg, but it is [40.0, 10.0, 16.0, "
        "22.0, 28.0, 34.0]; sort them and remove repeated ones"
    )
    assert_refused(fit("--parameters", folder / "p.cdfx"), sentence, folder / "out")


@pytest.mark.parametrize(("model", "usual"), [("static-map", "steady-plunger"), ("plunger-map", "table")])
@pytest.mark.parametrize("stated_where", ["file", "study"])
def test_the_usual_flow_map_is_the_same_model_stated_or_not(model, usual, stated_where, tmp_path):
    silent, loud = (AnyStudy.validate_python({"model": model, "components": c}) for c in ({}, {"flow_map": usual}))
    given, study = (loud, silent) if stated_where == "file" else (silent, loud)
    plant = build_model(study)
    path = tmp_path / "p.json"
    path.write_text(json.dumps(to_json(given, tabulate(plant, plant, {}, {}))))
    assert load_values(path, None, study, plant)["diaphragm.mass"] == float(plant.diaphragm.mass)
    other = AnyStudy.validate_python({"model": "static-map", "components": {"flow_map": "polynomial"}})
    with pytest.raises(vgtjax.InputError, match=r"^p\.json: these are parameters of "):
        load_values(path, None, other, build_model(other))


ANGLES, PRESSURES = np.array([4.0, 10.0, 16.0, 22.0, 28.0, 34.0]), np.array([1.5e5, 3.0e5])


def force_at(pressures, angles) -> np.ndarray:
    """N, linear in the crank angle and in the pressure, so that a table on any knots within has it exactly."""
    return (np.asarray(pressures)[:, None] / 1e5 * (10.0 + np.asarray(angles))).ravel()


@pytest.mark.parametrize("counts", [{}, {"fit": {"free": ["vane_force.closing"]}}], ids=["held", "free"])
@pytest.mark.parametrize(
    ("stated", "pressures", "angles"),
    [
        ({"crank_angle": [4.0, 7.0, 10.0, 13.0, 16.0, 19.0]}, PRESSURES, [4.0, 7.0, 10.0, 13.0, 16.0, 19.0]),
        ({"crank_angle": [5.0, 9.0, 33.0]}, PRESSURES, [5.0, 9.0, 33.0]),
        ({"crank_angle[1]": 7.0, "crank_angle[2]": 11.0}, PRESSURES, [4.0, 7.0, 11.0, 22.0, 28.0, 34.0]),
        ({"turbine_pressure[1]": 2.0e5}, [1.5e5, 2.0e5], ANGLES),
        ({"crank_angle": [5.0, 9.0, 33.0], "crank_angle[1]": 20.0}, PRESSURES, [5.0, 20.0, 33.0]),
    ],
    ids=["as many", "fewer", "by entry", "pressure", "both"],
)
def test_an_earlier_table_keeps_its_force_at_the_knots_that_a_study_states(stated, pressures, angles, counts):
    parameters = {f"vane_force.{name}": {"value": value} for name, value in stated.items()}
    study = AnyStudy.validate_python({"components": {"vane_force": "map"}, "parameters": parameters, **counts})
    model = build_model(study)
    earlier = values_of(vgtjax.Actuator(vane_force=vgtjax.HysteresisMap()))
    earlier["vane_force.closing"] = force_at(PRESSURES, ANGLES).tolist()
    vane_force = start_model(model, study, earlier)[0].vane_force
    np.testing.assert_array_equal(vane_force.turbine_pressure, pressures)
    np.testing.assert_array_equal(vane_force.crank_angle, angles)
    # Some tens of roundings of hundreds of N.
    np.testing.assert_allclose(vane_force.closing, force_at(pressures, angles), rtol=1e-13)


def test_an_entry_that_a_file_has_not_is_free_where_the_study_states_its_knot():
    pressures = [0.75e5, 1.5e5, 3.0e5]
    study = AnyStudy.validate_python(
        {
            "components": {"vane_force": "map"},
            "parameters": {"vane_force.turbine_pressure": {"value": pressures}},
            "fit": {"free": ["vane_force.closing[17]"]},
        }
    )
    earlier = values_of(vgtjax.Actuator(vane_force=vgtjax.HysteresisMap()))
    earlier["vane_force.closing"] = force_at(PRESSURES, ANGLES).tolist()
    vane_force = start_model(build_model(study), study, earlier)[0].vane_force
    np.testing.assert_allclose(vane_force.closing, force_at(pressures, ANGLES), rtol=1e-13)


def test_a_data_set_that_is_not_there(folder, fit):
    path = folder / "no.dcm"
    assert_refused(
        fit("--parameters", path), f"{path}: can't be read (No such file or directory); check the path", folder / "out"
    )


STEP = """[[trace]]
file = "step.csv"
"""


def with_step(folder, more: str):
    """A study of one step at 1 s, recorded each millisecond."""
    time = 1e-3 * np.arange(2001)
    rows = np.column_stack([time, np.where(time >= 1.0, 50.0, 0.0), np.full_like(time, 5e-3)])
    np.savetxt(folder / "step.csv", rows, delimiter=",", header="time [s],pwm [%],x_d [m]", comments="")
    (folder / "study.toml").write_text(STEP + more)
    return folder / "study.toml"


def test_a_window_begins_with_what_was_asked_for_before_it(tmp_path):
    study = with_step(tmp_path, "window = [1.001, 1.9]\nduty_delay = 0.02\n")
    ((_, trace),) = prepare(study, None).units[0].traces
    duty = trace.at("pwm")
    np.testing.assert_allclose(trace.time[trace.jumps()], 1.02, atol=1e-9)
    assert (duty[0], duty[-1]) == (0.0, 50.0)
    assert trace.time[0] == pytest.approx(1.001)


@pytest.mark.parametrize("stated", ["duty_delay = 0.004\n", "duty_hold = 'zero-order'\n"])
def test_what_a_study_states_of_a_duty_counts_and_not_once_more_what_a_fit_has_found(tmp_path, stated):
    found = {"duty_delay": 0.004, "duty_hold": "linear" if "hold" in stated else "zero-order"}
    parameters = {**read(FLEET_UNIT), "parameters": {}, "nuisance": {"step": found}}
    (tmp_path / "parameters.json").write_text(json.dumps(parameters))
    study = with_step(tmp_path, stated + f"[components]\nvane_force = '{parameters['components']['vane_force']}'\n")
    unit = prepare(study, tmp_path / "parameters.json").units[0]
    ((_, trace),) = unit.traces
    applied = unit.duties["step"].applied(trace)
    assert applied.duty_hold == "zero-order"
    np.testing.assert_allclose(applied.time[applied.jumps()], 1.004, atol=1e-9)


def test_edges_that_were_found_beside_a_stated_delay_stay():
    edges = (1e-3, -5e-4)
    assert beside(FoundDuty(0.0, False, edges), 4e-3, None) == FoundDuty(0.0, False, edges)
    assert beside(FoundDuty(4e-3, False, edges), 4e-3, None) == FoundDuty(0.0, False)
