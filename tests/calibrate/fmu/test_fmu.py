"""An FMU as other tools see it: valid, and the library's simulation to rounding, without any Python."""

import importlib.metadata
import pathlib
import shutil
import zipfile

import fmpy
import numpy as np
import pytest
from commands import Outcome, run_command
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from support import EXAMPLE

import vgtjax
from calibrate.fmu import compilers, package
from calibrate.fmu.plant import plant_unit
from calibrate.study.start_file import load_model, read_parameters

from .opened import Unit, own_only
from .variants import build

UNIT = EXAMPLE / "fleet" / "units" / "unit_01" / "parameters.json"
NONE = (
    "error: an FMU needs a C compiler, but there is none; install gcc or clang, or run pip install '.[fmu]' in a clone "
    "of vgtjax\n"
)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory) -> pathlib.Path:
    """A calibrated unit with vane forces, exported as a user does it."""
    path = tmp_path_factory.mktemp("fmu") / "unit.fmu"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(package, "compilers", own_only)
        outcome = run_command("export", UNIT, "--format", "fmu", "--out", path, "--date", "2026-01-31")
    assert (outcome.status, outcome.err) == (0, "")
    return path


@pytest.fixture(scope="module")
def model() -> vgtjax.AbstractModel:
    return load_model(*read_parameters(UNIT))[1]


@pytest.fixture(scope="module")
def trace() -> vgtjax.Trace:
    trace = vgtjax.load_trace(EXAMPLE / "step_80.csv").window(0.0, 0.8)
    return trace.replace(p_trb=np.linspace(1e5, 2.5e5, len(trace.time)), p_res=2e4 + 3e3 * np.sin(9 * trace.time))


@pytest.fixture
def unit(fmu, tmp_path):
    """Opens the FMU; what is open is freed in the end."""
    opened: list[Unit] = []

    def open_unit(**values: float) -> Unit:
        opened.append(Unit(fmu, tmp_path / str(len(opened)), **values))
        return opened[-1]

    yield open_unit
    for each in opened:
        each.slave.terminate()
        each.slave.freeInstance()


def test_it_is_valid(fmu):
    assert validate_fmu(str(fmu)) == []


def test_it_describes_its_model(fmu, model):
    description = fmpy.read_model_description(str(fmu))
    variables = {each.name: each for each in description.modelVariables}
    assert description.generationTool == f"vgtjax {importlib.metadata.version('vgtjax')}"
    for name in vgtjax.parameters.entry_names(vgtjax.parameter_table(model)):
        value = vgtjax.Selection((name,)).pack(model)[0]
        assert float(variables[name].start) == value
    assert variables["diaphragm.stiffness"].unit == "N/m"
    assert {name for name, each in variables.items() if each.causality == "input"} == {"pwm", "p_res", "p_trb"}
    outputs = [name for name, each in variables.items() if each.causality == "output"]
    assert outputs == ["x_p", "v_p", "x_d", "v_d", "z", "f_vane", "T_act", "p_act", "m_dot_in", "m_dot_out"]


def test_co_simulation_is_the_librarys_simulation(unit, model, trace):
    solution = vgtjax.simulate(model, trace)
    x_d, p_act, f_vane = unit().run(trace, ("x_d", "p_act", "f_vane"))
    # The same steps of the same method: rounding only, a hundred times less than this.
    np.testing.assert_allclose(x_d, solution.x_d, rtol=0, atol=1e-11)
    np.testing.assert_allclose(p_act, solution.p_act, rtol=0, atol=1e-6)
    np.testing.assert_allclose(f_vane, solution.f_vane, rtol=0, atol=1e-8)
    assert np.ptp(x_d) > 5e-3


def test_parameters_can_be_set(unit, model, trace):
    values = {"diaphragm.stiffness": 9000.0, "vane_force.closing[3]": 7.5}
    closing = np.array(vgtjax.get_parameter(model, "vane_force.closing"))
    closing[3] = values["vane_force.closing[3]"]
    changed = {"diaphragm.stiffness": values["diaphragm.stiffness"], "vane_force.closing": closing}
    solution = vgtjax.simulate(vgtjax.replace_parameters(model, changed), trace)
    (x_d,) = unit(**values).run(trace, ("x_d",))
    np.testing.assert_allclose(x_d, solution.x_d, rtol=0, atol=1e-11)


def test_a_communication_step_is_divided_as_the_library_divides_it(unit, model, trace):
    time = np.linspace(0.0, 0.6, 61)
    slow = trace.replace(time=time, **{name: trace.at(name, time) for name in trace.channels})
    solution = vgtjax.simulate(model, slow, stepping=vgtjax.simulation.FixedStep(max_step=1.5e-4))
    (x_d,) = unit(max_step=1.5e-4).run(slow, ("x_d",))
    np.testing.assert_allclose(x_d, solution.x_d, rtol=0, atol=1e-11)


def test_the_start_can_be_set(unit, model, trace):
    """Of a trace that begins in motion, at a pressure of its own and another atmosphere."""
    late = trace.replace(atmosphere=99000.0).window(0.4, 0.6)
    start = late.start()
    given = {
        "start.at_rest": bool(start.at_rest),
        "start.pressure": float(start.pressure),
        "start.pressure_known": bool(start.pressure_known),
        "start.position": float(start.position),
        "start.position_known": bool(start.position_known),
        "atmosphere": 99000.0,
    }
    solution = vgtjax.simulate(model, late)
    (x_d,) = unit(**given).run(late, ("x_d",))
    assert not start.at_rest
    np.testing.assert_allclose(x_d, solution.x_d, rtol=0, atol=1e-11)


def test_a_state_can_be_kept_and_gone_back_to(unit):
    """Also as bytes; and a reset is the start."""
    one = unit(pwm=60.0)
    one.slave.exitInitializationMode()
    begin = one["p_act"]
    one.slave.doStep(0.0, 0.05)
    kept = one.slave.serializeFMUstate(one.slave.getFMUState())
    one.slave.doStep(0.05, 0.05)
    first = one["x_d"]
    one.slave.setFMUState(one.slave.deSerializeFMUstate(kept))
    one.slave.doStep(0.05, 0.05)
    assert one["x_d"] == first
    one.slave.reset()
    one.slave.enterInitializationMode()
    assert one["p_act"] == begin


def test_model_exchange_comes_close_to_it(fmu, model):
    """With another solver, at a duty that does not jump."""
    time = np.arange(0.0, 0.3, 1e-3)
    trace = vgtjax.Trace(time, pwm=np.full_like(time, 45.0), p_res=np.full_like(time, 2e4), p_trb=0 * time + 1e5)
    solution = vgtjax.simulate(model, trace, stepping=vgtjax.simulation.FixedStep(max_step=2e-5))
    result = fmpy.simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        stop_time=time[-1],
        output_interval=1e-3,
        relative_tolerance=1e-8,
        start_values={"pwm": 45.0, "p_res": 2e4, "p_trb": 1e5, "start.at_rest": False},
        output=["x_d", "p_act"],
    )
    # Both solvers' errors; a millionth of the travel.
    np.testing.assert_allclose(result["x_d"], solution.x_d[: len(result)], rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["p_act"], solution.p_act[: len(result)], rtol=0, atol=1.0)


def test_numbers_that_are_not_finite_are_an_error(unit):
    one = unit(**{"diaphragm.mass": -1e-3})
    one["pwm"] = 80.0
    one.slave.exitInitializationMode()
    with pytest.raises(FMICallException):
        one.slave.doStep(0.0, 1.0)


@pytest.mark.parametrize("name", ["static-map-steady-plunger", "mechanical", "line-delay"])
def test_other_models_are_valid_too(tmp_path, monkeypatch, name):
    monkeypatch.setattr(package, "compilers", own_only)
    path = tmp_path / "model.fmu"
    path.write_bytes(package.to_fmu(plant_unit(build(name)), name, "0", "2026-01-31"))
    assert validate_fmu(str(path)) == []
    one = Unit(path, tmp_path / "unpacked")
    one.slave.exitInitializationMode()
    one.slave.doStep(0.0, 0.01)
    assert np.isfinite(one["x_d"])
    one.slave.freeInstance()


def test_the_source_compiles_by_itself_and_beside_others(fmu, tmp_path):
    """With a prefix, as where several units are linked into one program."""
    with zipfile.ZipFile(fmu) as archive:
        source = archive.read("sources/vgtjax_actuator.c").decode()
    system = compilers.own_system()
    flags = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-DFMI2_FUNCTION_PREFIX=mine_")
    assert b"mine_fmi2DoStep" in compilers.compile_library(source, system, compilers.compilers()[system], *flags)


def test_without_a_compiler_one_sentence_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(compilers, "find_spec", lambda name: None)
    out = tmp_path / "unit.fmu"
    outcome = run_command("export", UNIT, "--format", "fmu", "--out", out)
    assert (outcome.status, outcome.err) == (2, NONE)
    assert not out.exists()


def test_what_a_compiler_says_is_passed_on(tmp_path, monkeypatch):
    system = compilers.own_system()
    command = (*compilers.compilers()[system], "--no-such-flag")
    monkeypatch.setattr(package, "compilers", lambda: {system: command})
    outcome: Outcome = run_command("export", UNIT, "--format", "fmu", "--out", tmp_path / "unit.fmu")
    assert outcome.status == 1
    assert f"could not compile the FMU for {system}: " in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_other_systems_are_built_where_there_is_a_compiler_for_them(monkeypatch):
    monkeypatch.setattr(compilers, "find_spec", lambda name: object())
    found = compilers.compilers()
    assert set(found) == {"linux64", "win64", "darwin64"}
    others = {system: command[-1] for system, command in found.items() if system != compilers.own_system()}
    assert others == {system: compilers.SYSTEMS[system][0] for system in others}
