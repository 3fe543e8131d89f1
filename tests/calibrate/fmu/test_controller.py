"""A tuned controller as an FMU: valid, sampled by itself, and the library's closed loop beside the FMU of its plant."""

import json
import pathlib
import re
from collections.abc import Callable, Iterator

import fmpy
import numpy as np
import pytest
from commands import assert_refused, read, run_command
from fmpy.validation import validate_fmu
from support import EXAMPLE

import vgtjax
from calibrate.fmu import package
from calibrate.fmu.controller import controller_unit
from calibrate.study.parameter_file import tabulate
from calibrate.study.start_file import load_model, read_parameters
from calibrate.study.tables import AnyStudy
from calibrate.tune.designs import DESIGNS
from calibrate.tune.gains_file import gains_json, load_controller
from vgtjax.control import ClosedLoop, Scenario, Sine, WithFallback, close_loop

from .opened import Unit, own_only

PLANT = EXAMPLE / "fleet" / "units" / "unit_01" / "parameters.json"
DESIGN, GAIN, PERIOD = "friction-compensation", "proportional_gain", 2e-3
WANTED = ("position", "velocity", "acceleration")


@pytest.fixture(scope="module")
def plant() -> vgtjax.Actuator:
    return load_model(*read_parameters(PLANT))[1]


@pytest.fixture(scope="module")
def controller(plant) -> vgtjax.control.AbstractController:
    """As if it had been tuned."""
    return vgtjax.replace_parameters(DESIGNS[DESIGN].for_plant(plant), {GAIN: 9000.0, "observer_gain": 12.5})


@pytest.fixture(scope="module")
def results(plant, controller, tmp_path_factory) -> pathlib.Path:
    """A folder as `tune` leaves it."""
    folder, components = tmp_path_factory.mktemp("tuned"), {"vane_force": read(PLANT)["components"]["vane_force"]}
    control = {"design": DESIGN, "period": PERIOD}
    study = AnyStudy.validate_python({"model": "full", "components": components, "control": control})
    names = [GAIN, "derivative_gain", "observer_gain"]
    content = gains_json(study, tabulate(controller, controller, {}, {}, names), plant)
    (folder / "gains.json").write_text(json.dumps(content))
    return folder


def test_the_source_says_the_order_of_its_arrays(controller):
    """For a target without FMI: every name at its place, with its value and unit."""
    unit = controller_unit(controller, PERIOD)
    legend, rest = unit.code.split("*/", 1)
    said = re.findall(r"^  \[(\d+)\] ([\w.\[\]]+)", legend, re.MULTILINE)
    assert [name for _, name in said] == [each.name for each in unit.variables]
    assert [int(place) for place, name in said if name in ("x_d", GAIN, "pwm")].count(0) >= 2
    assert f"{GAIN} = 9000.0 N/m" in legend
    assert legend.index("u: inputs") < legend.index("x_d = 0.0 m") < legend.index("pwm %") < legend.index("memory.")
    assert "vg_start" in rest


@pytest.fixture(scope="module")
def fmus(results, tmp_path_factory) -> dict[str, pathlib.Path]:
    """The controller and its plant, exported as a user does it."""
    folder = tmp_path_factory.mktemp("fmus")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(package, "compilers", own_only)
        for name, place in (("controller", results), ("plant", PLANT)):
            outcome = run_command("export", place, "--format", "fmu", "--out", folder / f"{name}.fmu")
            assert (outcome.status, outcome.err) == (0, "")
    return {path.stem: path for path in folder.iterdir()}


@pytest.fixture
def unit(fmus, tmp_path) -> Iterator[Callable[..., Unit]]:
    """Opens one of them; what is open is freed in the end."""
    opened: list[Unit] = []

    def open_unit(name: str, **values: float) -> Unit:
        opened.append(Unit(fmus[name], tmp_path / str(len(opened)), **values))
        return opened[-1]

    yield open_unit
    for each in opened:
        each.slave.terminate()
        each.slave.freeInstance()


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario(Sine(amplitude=0.003, rate=15.0, offset=0.005), Sine(5e4, 3.0, 1.5e5))


@pytest.fixture(scope="module")
def run(plant, controller, scenario) -> ClosedLoop:
    return close_loop(plant, controller, scenario, 0.4, period=PERIOD)


def give(one: Unit, run: ClosedLoop, sample: int, position: float) -> None:
    one["x_d"], one["p_res"] = position, run.measured.reservoir[sample]
    for name in WANTED:
        one[f"reference.{name}"] = getattr(run.reference, name)[sample]


def co_simulate(controller: Unit, plant: Unit, run: ClosedLoop, scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Duty and position at every sample; a step a sample, the controller's duty at once."""
    drive, found = scenario.drive(run.time, PERIOD), []
    for each in (controller, plant):
        each.slave.exitInitializationMode()
    for i, time in enumerate(np.asarray(run.time)):
        plant.ramp("p_res", drive.reservoir.start[i], drive.reservoir.rate[i])
        plant.ramp("p_trb", drive.turbine.start[i], drive.turbine.rate[i])
        position = plant["x_d"]
        give(controller, run, i, position)
        plant["pwm"] = duty = controller["pwm"]
        found.append((duty, position))
        if i < len(run.time) - 1:
            controller.slave.doStep(time, PERIOD)
            plant.slave.doStep(time, PERIOD)
    return tuple(np.array(found).T)


def test_it_is_valid_and_says_what_it_is(fmus, controller):
    assert validate_fmu(str(fmus["controller"])) == []
    description = fmpy.read_model_description(str(fmus["controller"]))
    variables = {each.name: each for each in description.modelVariables}
    inputs = {name for name, each in variables.items() if each.causality == "input"}
    assert inputs == {"x_d", "p_res", "atmosphere", *(f"reference.{name}" for name in WANTED)}
    outputs = [name for name, each in variables.items() if each.causality == "output"]
    assert outputs == ["pwm", "command", "log.friction", "log.velocity", "log.wanted_pressure"]
    assert (float(variables[GAIN].start), variables[GAIN].unit) == (9000.0, "N/m")
    assert description.modelExchange is None
    assert float(description.defaultExperiment.stepSize) == PERIOD
    assert "FrictionCompensation, sampled every 0.002 s" in description.description


def test_beside_its_plant_it_is_the_closed_loop(unit, run, scenario):
    start = {"start.at_rest": True}
    duty, position = co_simulate(unit("controller"), unit("plant", **start), run, scenario)
    # Rounding, which a loop that sticks and slips amplifies: a thousand times what is seen.
    np.testing.assert_allclose(duty, run.duty, rtol=0, atol=1e-6)
    np.testing.assert_allclose(position, run.position, rtol=0, atol=1e-11)
    assert np.ptp(position) > 1e-3


def test_gains_can_be_set(unit, plant, controller, scenario):
    other = vgtjax.replace_parameters(controller, {GAIN: 7000.0})
    run = close_loop(plant, other, scenario, 0.4, period=PERIOD)
    duty, _ = co_simulate(unit("controller", **{GAIN: 7000.0}), unit("plant"), run, scenario)
    np.testing.assert_allclose(duty, run.duty, rtol=0, atol=1e-6)


def test_its_duty_holds_from_sample_to_sample(unit, run):
    """However short communication steps are."""
    one = unit("controller")
    one.slave.exitInitializationMode()
    for i in range(20):
        give(one, run, i, run.measured.position[i])
        for part in range(4):
            one.slave.doStep((i + 0.25 * part) * PERIOD, 0.25 * PERIOD)
            if part < 3:
                one["x_d"] = 0.0  # between two samples nothing looks at it
            assert one["pwm"] == pytest.approx(float(run.duty[i]), abs=1e-9)


def test_a_step_of_several_periods_is_as_many_samples(unit, run):
    """Along the ramp of an input that has a derivative."""
    long, short = unit("controller"), unit("controller")
    for one in (long, short):
        one.slave.exitInitializationMode()
        give(one, run, 0, 0.004)
    long.ramp("x_d", 0.004, 0.1)
    long.slave.doStep(0.0, 5 * PERIOD)
    for i in range(5):
        short["x_d"] = 0.004 + 0.1 * i * PERIOD
        short.slave.doStep(i * PERIOD, PERIOD)
    for name in ("pwm", "memory.deflection", "memory.differentiator.slope"):
        assert long[name] == pytest.approx(short[name], rel=1e-9)
        assert long[name] != 0.0


def test_its_state_can_be_kept(unit, run):
    """With the time to the next sample."""
    one = unit("controller")
    one.slave.exitInitializationMode()
    give(one, run, 0, 0.004)
    one.slave.doStep(0.0, 0.3 * PERIOD)
    kept, held = one.slave.serializeFMUstate(one.slave.getFMUState()), one["pwm"]
    one["x_d"] = 0.002
    one.slave.doStep(0.3 * PERIOD, 3 * PERIOD)
    after = one["pwm"]
    assert after != held
    one.slave.setFMUState(one.slave.deSerializeFMUstate(kept))
    assert one["pwm"] == held
    one["x_d"] = 0.002
    one.slave.doStep(0.3 * PERIOD, 3 * PERIOD)
    assert one["pwm"] == after


def test_a_file_of_gains_is_its_controller(results, controller):
    tuned = load_controller(results / "gains.json")
    assert (tuned.design, tuned.period) == (DESIGN, PERIOD)
    for name in vgtjax.parameter_table(controller):
        np.testing.assert_array_equal(
            vgtjax.get_parameter(tuned.controller, name), vgtjax.get_parameter(controller, name)
        )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"design": "mpc"}, "its design must be one of {designs}, but it is 'mpc'; tune again"),
        ({"design": ["pi"]}, "its design must be one of {designs}, but it is ['pi']; tune again"),
        ({"components": []}, "its components must be names by part, but they are []; correct them"),
        ({"parameters": [1]}, "these are no gains of a controller; give a gains.json that 'tune' wrote"),
        ({"plant": None}, "it does not state the plant that its controller believes in and its period; tune again"),
        (
            {"fallback": {"kind": "prayer", "patience": 0.1}},
            "its fallback must be of kind 'static-balance' with a patience in s, or null for ever, but it is "
            "{{'kind': 'prayer', 'patience': 0.1}}; tune again",
        ),
        ({"period": -1.0}, "it does not state the plant that its controller believes in and its period; tune again"),
        (
            {"parameters": {"derivative_gain": {"value": "high"}}},
            "the gain 'derivative_gain' must be a number, but it is 'high'; correct it",
        ),
    ],
)
def test_gains_that_are_not_as_tune_writes_them_are_refused(results, tmp_path, change, sentence):
    (tmp_path / "gains.json").write_text(json.dumps(read(results / "gains.json") | change))
    outcome = run_command("export", tmp_path, "--format", "fmu", "--out", tmp_path / "a.fmu")
    assert_refused(outcome, f"gains.json: {sentence.format(designs=', '.join(DESIGNS))}", tmp_path / "a.fmu")


@pytest.mark.parametrize(("patience", "expected"), [(0.05, 0.05), (None, np.inf)])
def test_a_fallback_is_a_part_of_what_is_exported(results, tmp_path, patience, expected):
    said = {"kind": "static-balance", "patience": patience}
    (tmp_path / "gains.json").write_text(json.dumps(read(results / "gains.json") | {"fallback": said}))
    tuned = load_controller(tmp_path / "gains.json")
    assert isinstance(tuned.controller, WithFallback)
    assert float(tuned.controller.patience) == expected
    assert type(tuned.controller.controller) is DESIGNS[DESIGN]


def test_a_controller_is_no_data_set(results, tmp_path):
    outcome = run_command("export", results, "--format", "cdfx", "--out", tmp_path / "a.cdfx")
    sentence = "gains.json holds a controller, which is exported as fmu, but --format is cdfx; change it"
    assert_refused(outcome, sentence, tmp_path / "a.cdfx")
