"""What `export` writes reads back: names, numbers to the last digit, units, axes, and where they come from."""

import csv
import hashlib
import importlib.metadata
import json
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import scipy.io
from commands import Outcome, entries_of, read, run_command
from dcmReader.dcm_reader import DcmReader

from calibrate.study.characteristics.base import identifier, parameter_name
from calibrate.study.start_file import load_model, read_parameters

from .conftest import DATE, FLEET_UNIT

VERSION = importlib.metadata.version("vgtjax")
ORDER = {
    "MSRSW": ["SHORT-NAME", "CATEGORY", "SW-SYSTEMS"],
    "SW-SYSTEM": ["SHORT-NAME", "SW-INSTANCE-SPEC"],
    "SW-INSTANCE-TREE": ["SHORT-NAME", "LONG-NAME", "CATEGORY", "SW-INSTANCE"],
    "SW-INSTANCE": ["SHORT-NAME", "LONG-NAME", "CATEGORY", "SW-VALUE-CONT", "SW-AXIS-CONTS", "SW-CS-HISTORY"],
    "SW-VALUE-CONT": ["UNIT-DISPLAY-NAME", "SW-ARRAYSIZE", "SW-VALUES-PHYS"],
    "SW-AXIS-CONT": ["CATEGORY", "SW-INSTANCE-REF"],
    "CS-ENTRY": ["STATE", "DATE", "CSTO", "CSTV", "REMARK", "SD"],
}
"""Children of the elements of a CDFX file, in the order of its schema."""


def dcm(path) -> DcmReader:
    reader = DcmReader()
    reader.read(str(path))
    return reader


def by_name(found: list) -> dict:
    return {each.name: each for each in found}


@pytest.fixture(scope="module")
def fleet_unit() -> dict:
    return read(FLEET_UNIT)["parameters"]


# -- CDFX --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def instances(export) -> dict[str, ET.Element]:
    path, outcome = export(FLEET_UNIT, "cdfx")
    assert outcome.status == 0
    return {each.findtext("SHORT-NAME"): each for each in ET.parse(path).iter("SW-INSTANCE")}


def numbers(element: ET.Element) -> list[float]:
    return [float(value.text) for value in element.find("SW-VALUE-CONT/SW-VALUES-PHYS").iter("V")]


def test_cdfx_keeps_to_the_order_of_its_schema(export):
    root = ET.parse(export(FLEET_UNIT, "cdfx")[0]).getroot()
    assert (root.tag, root.findtext("CATEGORY")) == ("MSRSW", "CDF20")
    seen = set()
    for element in root.iter():
        if element.tag in ORDER:
            seen.add(element.tag)
            places = [ORDER[element.tag].index(child.tag) for child in element]  # fails for one that is not allowed
            assert places == sorted(places)
    assert seen == set(ORDER)


def test_cdfx_has_every_number_and_unit(instances, fleet_unit):
    found = {}
    for name, instance in instances.items():
        if name.startswith("derived__"):
            continue
        values = numbers(instance)
        scalar = instance.findtext("CATEGORY") == "VALUE"
        names = [parameter_name(name)] if scalar else [f"{parameter_name(name)}[{i}]" for i in range(len(values))]
        unit = instance.findtext("SW-VALUE-CONT/UNIT-DISPLAY-NAME")
        found |= {each: (value, unit) for each, value in zip(names, values, strict=True)}
    assert found == {name: (fields["value"], fields["unit"]) for name, fields in entries_of(fleet_unit).items()}


def test_cdfx_maps_refer_to_their_axes(instances, fleet_unit):
    table = instances["vane_force__closing"]
    axes = [axis.findtext("SW-INSTANCE-REF") for axis in table.iter("SW-AXIS-CONT")]
    assert (table.findtext("CATEGORY"), axes) == ("MAP", ["vane_force__crank_angle", "vane_force__turbine_pressure"])
    rows = [[float(value.text) for value in row.iter("V")] for row in table.iter("VG")]
    columns, pressures = (numbers(instances[axis]) for axis in axes)
    assert np.shape(rows) == (len(pressures), len(columns))
    assert list(np.ravel(rows)) == fleet_unit["vane_force.closing"]["value"]
    assert {instances[axis].findtext("CATEGORY") for axis in axes} == {"COM_AXIS"}


def test_the_magnetic_force_is_a_curve(instances):
    curve = instances["derived__magnetic_force"]
    (axis,) = (each.findtext("SW-INSTANCE-REF") for each in curve.iter("SW-AXIS-CONT"))
    duties, model = numbers(instances[axis]), load_model(*read_parameters(FLEET_UNIT))[1]
    assert (curve.findtext("CATEGORY"), axis, duties[0], duties[-1]) == ("CURVE", "derived__duty", 0.0, 100.0)
    assert numbers(curve) == [float(model.converter.magnetic_force.steady_pull(duty, 0.0)) for duty in duties]


def test_names_go_to_identifiers_and_back():
    assert identifier("converter.magnetic_force[2]") == "converter__magnetic_force__2"
    assert parameter_name("converter__magnetic_force__2") == "converter.magnetic_force[2]"


def test_short_names_are_identifiers(instances):
    assert all(name.isidentifier() and name.isascii() for name in instances)
    assert all(identifier(parameter_name(name)) == name for name in instances)


def test_cdfx_says_where_a_value_comes_from(fitted, export):
    path, outcome = export(fitted.out, "cdfx")
    assert outcome == Outcome(0, f"wrote {path}\n", "")
    stiffness = next(each for each in ET.parse(path).iter("SW-INSTANCE") if "stiffness" in each.findtext("LONG-NAME"))
    name = parameter_name(stiffness.findtext("SHORT-NAME"))
    entry = stiffness.find("SW-CS-HISTORY/CS-ENTRY")
    assert [entry.findtext(tag) for tag in ("DATE", "CSTO", "CSTV")] == [f"{DATE}T00:00:00", "vgtjax", VERSION]
    assert name in entry.findtext("REMARK/P")
    digests = {each.get("GID"): each.text for each in entry.iter("SD")}
    files = {name: (fitted.study.parent / f"{name}.csv").read_bytes() for name in ("step_80", "step_50")}
    assert digests == {f"SHA-256 of {name}": hashlib.sha256(content).hexdigest() for name, content in files.items()}


def test_cdfx_says_how_sure_a_fit_is(fitted, export):
    fields = read(fitted.out / "parameters.json")["parameters"]["diaphragm.stiffness"]
    low, high = fields["interval"]
    sentence = f"diaphragm.stiffness: standard error {fields['std_error']!r} N/m, 95 % from {low!r} to {high!r} N/m"
    root = ET.parse(export(fitted.out, "cdfx")[0])
    said = {each.findtext("SHORT-NAME"): each for each in root.iter("SW-INSTANCE")}
    assert said["diaphragm__stiffness"].findtext(".//REMARK/P") == sentence
    assert said["diaphragm__stiffness"].findtext(".//STATE") == "calibrated"
    assert said["diaphragm__mass"].findtext(".//REMARK/P") == "diaphragm.mass: held"


# -- DCM ---------------------------------------------------------------------------------------------------------------


def test_dcm_has_every_number_and_unit(export, fleet_unit):
    reader = dcm(export(FLEET_UNIT, "dcm")[0])
    entries = entries_of(fleet_unit)
    for value in reader.get_parameters():
        fields = entries[parameter_name(value.name)]
        assert (value.value, value.unit) == (fields["value"], fields["unit"])
    distributions = [each for each in reader._distribution_list if each.name != "derived__duty"]
    for axis in distributions:
        fields = fleet_unit[parameter_name(axis.name)]
        assert (axis.values, {axis.unit_x}) == (fields["value"], set(fields["unit"]))
    blocks = {parameter_name(block.name): block.values[0] for block in reader.get_block_parameters()}
    tables = reader.get_group_characteristic_maps()
    assert len(tables) == 2
    for table in tables:
        rows = [list(row.values()) for row in table.values.values()]
        assert list(np.ravel(rows)) == fleet_unit[parameter_name(table.name)]["value"]
    counted = len(reader.get_parameters()) + sum(
        np.size(fleet_unit[parameter_name(each.name)]["value"]) for each in (*distributions, *tables)
    )
    assert counted + sum(map(len, blocks.values())) == len(entries)


def test_dcm_maps_stand_over_their_axes(export, fleet_unit):
    table = by_name(dcm(export(FLEET_UNIT, "dcm")[0]).get_group_characteristic_maps())["vane_force__opening"]
    assert list(table.values) == fleet_unit["vane_force.turbine_pressure"]["value"]
    assert all(list(row) == fleet_unit["vane_force.crank_angle"]["value"] for row in table.values.values())
    assert (table.x_mapping, table.y_mapping) == ("vane_force__crank_angle", "vane_force__turbine_pressure")
    assert (table.unit_x, table.unit_y, table.unit_values) == ("deg", "Pa gauge", "N")


def test_dcm_has_the_magnetic_force_as_a_curve(export):
    (curve,) = dcm(export(FLEET_UNIT, "dcm")[0]).get_group_characteristic_lines()
    model = load_model(*read_parameters(FLEET_UNIT))[1]
    assert (curve.name, curve.x_mapping, curve.unit_x, curve.unit_values) == (
        "derived__magnetic_force",
        "derived__duty",
        "%",
        "N",
    )
    force = {duty: float(model.converter.magnetic_force.steady_pull(duty, 0.0)) for duty in curve.values}
    assert len(force) == 21
    assert curve.values == force


def test_dcm_says_where_it_comes_from(fitted, export):
    path = export(fitted.out, "dcm")[0]
    digest = hashlib.sha256((fitted.study.parent / "step_80.csv").read_bytes()).hexdigest()
    assert f"* SHA-256 of step_80: {digest}\n" in path.read_text()
    stiffness = by_name(dcm(path).get_parameters())["diaphragm__stiffness"]
    assert stiffness.description == "diaphragm.stiffness (k_sm)"
    assert f"vgtjax {VERSION}, {DATE}" in stiffness.comment
    assert "diaphragm.stiffness: standard error " in stiffness.comment


# -- tables ------------------------------------------------------------------------------------------------------------


def test_csv_has_a_row_for_each_entry(fitted, export):
    with open(export(fitted.out, "csv")[0], newline="") as file:
        rows = {row.pop("name"): row for row in csv.DictReader(file)}
    entries = entries_of(read(fitted.out / "parameters.json")["parameters"])
    assert list(rows) == list(entries)
    for name, row in rows.items():
        fields = entries[name]
        low, high = fields["interval"] or (None, None)
        assert (float(row["value"]), row["unit"]) == (fields["value"], fields["unit"])
        written = [float(row[key]) if row[key] else None for key in ("std_error", "low", "high")]
        assert written == [fields["std_error"], low, high]
        assert (row["free"], row["identifiable"]) == (str(fields["free"]), str(fields["identifiable"]))
    assert rows["diaphragm.stiffness"]["std_error"] != ""


def test_mat_is_a_struct_of_columns(fitted, export):
    found = scipy.io.loadmat(export(fitted.out, "mat")[0], simplify_cells=True)["calibration"]
    entries = entries_of(read(fitted.out / "parameters.json")["parameters"])
    assert list(found["name"]) == list(entries)
    assert list(found["unit"]) == [fields["unit"] for fields in entries.values()]
    np.testing.assert_array_equal(found["value"], [fields["value"] for fields in entries.values()])
    errors = [math.nan if fields["std_error"] is None else fields["std_error"] for fields in entries.values()]
    np.testing.assert_array_equal(found["std_error"], errors)
    assert (found["version"], found["model"], found["components"]["friction"]) == (VERSION, "full", "lugre")
    assert list(found["traces"]["trace"]) == ["step_80", "step_50"]


@pytest.mark.parametrize("kind", ["csv", "cdfx", "dcm", "mat"])
def test_the_same_results_are_the_same_file(export, kind):
    first, second = (export(FLEET_UNIT, kind, name=name)[0].read_bytes() for name in ("first", "second"))
    assert first == second


# -- bad input ---------------------------------------------------------------------------------------------------------


def refused(outcome: Outcome) -> str:
    assert (outcome.status, outcome.out) == (2, "")
    return outcome.err.removeprefix("error: ").removesuffix("\n")


def test_several_units_are_too_many(export):
    folder = FLEET_UNIT.parents[1]
    path, outcome = export(folder, "csv")
    units = ", ".join(f"unit_{number:02d}" for number in range(1, 21))
    assert refused(outcome) == (
        f"one actuator is exported at a time, but {folder} holds 20: {units}; give one of them, e.g. "
        f"{folder / 'unit_01'}"
    )
    assert not path.exists()


def test_a_file_that_is_there_stays(export, tmp_path):
    (tmp_path / "export.csv").write_text("mine")
    path, outcome = export(FLEET_UNIT, "csv")
    assert refused(outcome) == f"{path} is there already; remove it, or choose another --out"
    assert path.read_text() == "mine"


def test_a_file_is_no_folder(tmp_path):
    """Said before anything is computed."""
    (tmp_path / "p.json").write_text("mine")
    out = tmp_path / "p.json" / "further" / "y.csv"
    outcome = run_command("export", "nothing", "--format", "csv", "--out", out)
    assert refused(outcome) == f"--out must lie in a folder, but {tmp_path / 'p.json'} is a file; choose another --out"


def test_the_ending_says_what_a_file_is(tmp_path):
    outcome = run_command("export", FLEET_UNIT, "--format", "dcm", "--out", tmp_path / "a.cdfx")
    assert refused(outcome) == "--out must end in .dcm, as --format says, but it is a.cdfx; rename it"


def test_a_data_set_is_no_result(export):
    path, _ = export(FLEET_UNIT, "cdfx")
    assert refused(export(path, "dcm")[1]) == (
        "export.cdfx: what is exported is a parameters.json or the folder of a fit; give one of them"
    )


def test_results_without_a_model_are_refused(export, tmp_path):
    (tmp_path / "p.json").write_text('{"parameters": {}}')
    assert refused(export(tmp_path / "p.json", "csv")[1]) == (
        "p.json: no study has its model and components; use a newer vgtjax"
    )


@pytest.mark.parametrize("components", ["x", 3, None, ["dahl"]])
def test_components_that_are_no_table_are_refused(export, tmp_path, components):
    (tmp_path / "p.json").write_text(json.dumps({**read(FLEET_UNIT), "components": components}))
    assert refused(export(tmp_path / "p.json", "csv")[1]) == (
        f"p.json: its components must be names by part, but they are {components!r}; correct them"
    )


@pytest.mark.parametrize("summary", ["[]", '{"traces": {"a": 3}}', '{"traces": 3}'])
def test_another_summary_beside_the_parameters_is_refused(export, tmp_path, summary):
    (tmp_path / "parameters.json").write_bytes(FLEET_UNIT.read_bytes())
    (tmp_path / "summary.json").write_text(summary)
    assert refused(export(tmp_path, "csv")[1]) == (
        "summary.json: beside parameters only the summary of their fit may stand, but this is none; remove it"
    )


@pytest.mark.parametrize(
    ("name", "key", "given", "sentence"),
    [
        ("diaphragm.mass", "interval", [1], "interval of 'diaphragm.mass' must be two numbers, or null, but it is [1]"),
        ("diaphragm.mass", "interval", 5, "interval of 'diaphragm.mass' must be two numbers, or null, but it is 5"),
        ("diaphragm.mass", "std_error", "x", "std_error of 'diaphragm.mass' must be a number or null, but it is 'x'"),
        ("diaphragm.mass", "unit", ["kg"], "unit of 'diaphragm.mass' must be a text, but it is ['kg']"),
        ("converter.magnetic_force", "unit", ["N"], "'converter.magnetic_force' has 5 values, but 1 under unit"),
    ],
)
def test_fields_that_no_fit_writes_are_refused(export, tmp_path, name, key, given, sentence):
    content = read(FLEET_UNIT)
    content["parameters"][name][key] = given
    (tmp_path / "p.json").write_text(json.dumps(content))
    path, outcome = export(tmp_path / "p.json", "dcm")
    assert refused(outcome).startswith(f"p.json: {sentence}; give ")
    assert not path.exists()


def test_parameters_with_a_byte_order_mark_are_read(export, tmp_path):
    (tmp_path / "p.json").write_text(FLEET_UNIT.read_text(encoding="utf-8"), encoding="utf-8-sig")
    written, outcome = export(tmp_path / "p.json", "csv")
    assert outcome.status == 0
    assert written.read_bytes() == export(FLEET_UNIT, "csv", name="same")[0].read_bytes()


def test_results_that_lack_a_parameter_are_refused(export, tmp_path):
    (tmp_path / "p.json").write_text('{"model": "full", "parameters": {}}')
    outcome = export(tmp_path / "p.json", "csv")[1]
    assert outcome.status == 2
    assert outcome.err == (
        "error: p.json: it does not state 'converter.plunger_mass' with its unit; give one that 'fit' wrote\n"
    )
