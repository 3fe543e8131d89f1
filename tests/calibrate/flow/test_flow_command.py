"""The command `flow` as a user runs it."""

import contextlib
import csv
import dataclasses
import operator
import pathlib
from unittest import mock

import numpy as np
import pytest
from commands import Outcome, cut_example, read, run_command
from pages import Page
from report_numbers import assert_cards, assert_shown, shown
from support import quick_nozzle

import vgtjax
from calibrate.flow import command, nozzle_map
from calibrate.flow.passages import along_passage
from calibrate.flow.pulse import Pulse, engine_pulse
from calibrate.flow.stage import parts_of, turbine_of
from calibrate.study.disturbances import PulsationTable
from calibrate.study.read import load_study
from vgtjax import SimulationError
from vgtjax.parts import Stage
from vgtjax.parts.vane_force import _stage_table
from vgtjax.turbine import Gas, Nozzle

FEW = {"PRESSURES": 3, "ANGLES": 3}
COARSE = {"PRESSURES": 7, "ANGLES": 7, "ALL": np.ones(7, bool)}
"""Of the table that the engine and the rod read."""


@contextlib.contextmanager
def few_points():
    """Maps and tables that take few flows."""
    _stage_table._remembered.cache_clear()
    with mock.patch.multiple(nozzle_map, **FEW), mock.patch.multiple(_stage_table, **COARSE):
        yield
    _stage_table._remembered.cache_clear()


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> tuple[Outcome, pathlib.Path]:
    """The default geometry on few points."""
    out = tmp_path_factory.mktemp("flow") / "out"
    with few_points():
        return run_command("flow", "--out", out), out


def test_it_writes_the_map(ran):
    outcome, out = ran
    assert (outcome.status, outcome.err) == (0, "")
    rows = list(csv.DictReader((out / "map.csv").read_text().splitlines()))
    assert len(rows) == 9
    column = {name: np.array([float(row[name]) for row in rows]).reshape(3, 3) for name in rows[0]}
    # More passes at a higher pressure, and through wider vanes.
    assert np.all(np.diff(column["mass_flow [kg/s]"], axis=0) > 0)
    assert np.all(np.diff(column["mass_flow [kg/s]"], axis=1) > 0)
    np.testing.assert_allclose(column["vane_angle [deg]"][0, [0, -1]], [4.0, 4.0 + 33 * 48 / 31.6])
    # Virtual work: eleven vanes that turn by the ratio of rod and crank.
    turned = np.radians(48 / 31.6 * 3120.0)
    np.testing.assert_allclose(column["rod_force [N]"], 11 * turned * column["vane_moment [N m]"], rtol=1e-6)


def test_its_summary_and_its_report_say_that_nothing_was_measured(ran):
    outcome, out = ran
    said = read(out / "summary.json")
    assert said["points"] == 9
    most = said["quantities"]["mass_flow"]["most"]
    assert (most["total_pressure"], most["crank_angle"]) == (4.5e5, 37.0)
    page = (out / "report.html").read_text()
    for text in (outcome.out, said["notes"][0], page):
        assert "no measured vane force validates this" in text
    assert page.count("plotly-graph-div") == 4


def test_its_report_shows_the_numbers_of_the_summary_and_of_the_map(ran):
    said, text = read(ran[1] / "summary.json"), (ran[1] / "report.html").read_text()
    page, pulse = Page(text), said["pulsation"]
    cells = []
    for name, row in said["quantities"].items():
        cells.append({"quantity": name, "unit": row["unit"]})
        for kind, number in (("least", ""), ("most", " (2)")):
            at = {f"at, bar abs{number}": shown(row[kind]["total_pressure"] / 1e5, 3)}
            cells[-1] |= {kind: shown(row[kind]["value"]), **at, f"deg{number}": shown(row[kind]["crank_angle"], 3)}
    rows = page.table("quantity", "unit")
    assert_shown(rows, cells)
    columns = list(csv.DictReader((ran[1] / "map.csv").read_text().splitlines()))
    for row in rows:
        values = [float(each[f"{row['quantity']} [{row['unit']}]"]) for each in columns]
        assert [float(row["least"]), float(row["most"])] == pytest.approx([min(values), max(values)], rel=5e-5)
    cards = {"behind it, bar abs": "1.050", "gas, K": shown(said["total_temperature"], 4), "crank, deg": "4…37"}
    ends = "…".join(f"{pressure / 1e5:.2f}" for pressure in said["total_pressure"])
    assert_cards(page, cards | {"pressure before the turbine, bar abs": ends})
    parameters = {row["parameter"]: row["value"] for row in page.table("parameter", "value")}
    for name in ("nozzle.lead", "linkage.ratio", "gas.gamma", "total_temperature", "outlet_pressure", "speed_ratio"):
        assert parameters[name] == shown(float(operator.attrgetter(name)(Stage())))
    assert parameters["nozzle.rotor.blades"] == str(Nozzle().rotor.blades)
    for name in ("engine_speed", "crank_angle"):
        assert parameters[f"pulsation.{name}"] == shown(pulse[name])
    assert {"engine.bore", "engine.valve.lift", "pulsation.effective_area"} <= set(parameters)
    crank, mean = shown(pulse["crank_angle"], 3), f"{pulse['mean_pressure'] / 1e5:.3f}"
    assert f"the crank at {crank} deg; its mean pressure {mean} bar absolute" in text


def test_a_load_that_no_vane_bears_is_said_to_be_one(ran):
    """At 25 deg gas meets the vanes at 66 deg from the radius, and they stand at 43: 3 bar of load, of 2 bar before
    them. At 6 and 12 deg it is 1 bar and less."""
    page = (ran[1] / "report.html").read_text()
    assert page.count("so no vane can bear it") == 1
    assert "Note: at 25 deg gas meets the vanes far from their own direction" in page


def test_the_flow_along_the_passage_falls_to_the_outlet(ran):
    rows = list(csv.DictReader((ran[1] / "passage.csv").read_text().splitlines()))
    assert len(rows) == 3 * 224
    ends = [float(row["pressure [Pa abs]"]) for row in rows[223::224]]
    # The last cell lies half a cell before the outlet.
    np.testing.assert_allclose(ends, 1.05e5, rtol=1e-2)


def test_friction_holds_most_of_a_pulsation_off_the_rod(ran):
    pulse = read(ran[1] / "summary.json")["pulsation"]
    assert pulse["force_range"] > 1.0
    assert 5e-6 < pulse["position_range_with_friction"] < 0.6 * pulse["position_range_without_dry_friction"]


def test_the_engine_stands_before_this_nozzle(ran):
    """Where the nozzle takes what the engine's orifice of 87 mm2 takes, which has a mean pressure of 1.443 bar behind
    it at 1.03 bar; a coarse table and an outlet at 1.05 bar differ by some percents."""
    pulse = read(ran[1] / "summary.json")["pulsation"]
    assert pulse["engine_speed"] == 1000.0
    assert pulse["crank_angle"] == pytest.approx(6.7, abs=0.8)
    assert pulse["mean_pressure"] == pytest.approx(1.443e5, rel=0.05)


@pytest.fixture(scope="module")
def other() -> tuple[list, Pulse]:
    """Another stage before another engine: what is shown along the passage, and the pulse."""
    gas = Gas(gamma=1.3, constant=292.0)
    stage = Stage(outlet_pressure=2.2e5, wheel_speed=9000.0, nozzle=Nozzle(thickness=0.2e-3), gas=gas)
    engine = PulsationTable(engine_speed=1500.0, effective_area=150e-6)
    with few_points():
        return along_passage(stage), engine_pulse(turbine_of(stage), engine)


def test_what_is_shown_follows_the_stage(other):
    """2 bar would lie below this outlet."""
    along, pulse = other
    for each in along:
        assert each.total_pressure == pytest.approx(2.2e5 + 0.95 / 3.45 * 2.3e5)
        assert float(each.flow.mass_flow) > 0
        assert float(np.max(each.passage.speed)) == 9000.0
    assert (pulse.summary()["engine_speed"], pulse.source) == (1500.0, "[pulsation] of the study")
    assert pulse.summary()["crank_angle"] > 8.0
    assert np.min(pulse.pressure) > 2.2e5
    assert np.min(pulse.force) > 0
    # The manifold is full of what goes through the turbine.
    assert [float(pulse.engine.gas.heat_capacity_ratio), float(pulse.engine.gas.gas_constant)] == [1.3, 292.0]


def test_an_engine_that_does_not_run_before_it_is_a_note(monkeypatch):
    def failed(*_):
        raise SimulationError("the cycle of the engine failed")

    monkeypatch.setattr(command, "engine_pulse", failed)
    pulse, notes = command._pulse(None, command.Subject(Stage()))
    assert pulse is None
    assert notes == [command.ASSUMED, "no pulsation is shown, as the cycle of the engine failed"]


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({}, None),
        (
            {"outlet_pressure": 1.3e5, "amplitude": 0.05},
            "[pulsation] has no say here in outlet_pressure and amplitude: the engine empties through the nozzle, "
            "behind which there are 105000 Pa absolute",
        ),
    ],
)
def test_what_a_study_states_in_vain_of_its_engine_is_a_note(monkeypatch, stated, said):
    monkeypatch.setattr(command, "engine_pulse", lambda *_: None)
    engine = PulsationTable(engine_speed=1000.0, **stated)
    with quick_nozzle():
        _, notes = command._pulse(vgtjax.Turbine(), command.Subject(Stage(), engine=engine))
    assert notes == [command.ASSUMED, *([] if said is None else [said])]


def test_it_is_not_done_twice(ran):
    assert run_command("flow", "--out", ran[1]).out.startswith("nothing to do")


def test_a_study_may_give_the_speed_of_the_wheel(tmp_path):
    cut_example("step_50", 0.2, tmp_path)
    path = tmp_path / "study.toml"
    text = '[components]\nvane_force = "turbine-at-speed"\n[[trace]]\nfile = "step_50.csv"\n'
    path.write_text(f'{text}[parameters]\n"vane_force.wheel_speed" = {{value = 9000}}\n')
    with quick_nozzle():
        stage = parts_of(load_study(path))[0].stage
    assert [float(stage.speed_at(pressure)) for pressure in (1.5e5, 3e5)] == [9000.0, 9000.0]


def test_a_studys_own_rod_and_air_are_simulated(tmp_path):
    """Gauge pressure counts from the study's ambient pressure, and its stiffer bristles hold the rod."""
    path = tmp_path / "study.toml"
    bristles = {"friction.bristle_stiffness": 8 * 43135.0, "friction.bristle_damping": 8 * 429.77}
    values = {"vane_force.ambient_pressure": 9.0e4, **bristles}
    rows = "".join(f'"{name}" = {{value = {value}}}\n' for name, value in values.items())
    path.write_text(f'[components]\nvane_force = "turbine"\n[parameters]\n{rows}')
    with few_points():
        subject = command.Subject.of(path)
        viscous = vgtjax.PassiveLuGre(excess_damping=1000.0)
        rods = (subject.rod, None, dataclasses.replace(subject.rod, friction=viscous))
        stiff, printed, damped = (engine_pulse(subject.turbine, None, rod) for rod in rods)
    assert float(subject.turbine.ambient_pressure) == 9.0e4
    moved = [each.summary()["position_range_with_friction"] for each in (stiff, printed)]
    assert moved[0] < 0.5 * moved[1]
    free = [each.summary()["position_range_without_dry_friction"] for each in (stiff, printed, damped)]
    assert free[0] == pytest.approx(free[1], rel=1e-9)
    assert free[2] < 0.5 * free[0]  # viscous damping is none of it


def test_a_study_without_a_turbine_is_refused(tmp_path):
    (tmp_path / "study.toml").write_text('[components]\nvane_force = "map"\n')
    outcome = run_command("flow", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert outcome.status == 2
    assert "flow needs vane_force = 'turbine', but it is 'map'" in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Stage(nozzle=Nozzle(thickness=6e-3)), "error: vanes at 4 deg have no throat"),
        (lambda: Stage(nozzle=Nozzle(height=-1e-3)), "height"),
        (lambda: Stage(gas=Gas(constant=0.0)), "gas.constant must be a positive specific gas constant"),
    ],
)
def test_a_geometry_that_does_not_work_writes_nothing(make, sentence, tmp_path):
    with mock.patch.object(command, "Stage", make):
        outcome = run_command("flow", "--out", tmp_path / "out")
    assert outcome.status == 2
    assert sentence in outcome.err
    assert not (tmp_path / "out").exists()


def test_a_steady_state_that_is_not_found_is_named(tmp_path):
    found = np.ones((3, 3), bool)
    found[1, 2] = False
    with (
        mock.patch.multiple(nozzle_map, **FEW),
        mock.patch.object(nozzle_map, "_solve", return_value=((), found)),
    ):
        outcome = run_command("flow", "--out", tmp_path / "out")
    assert outcome.status == 1
    assert (
        "no steady flow through the nozzle was found at 4.5 bar absolute and a crank angle of 20.5 deg" in outcome.err
    )
