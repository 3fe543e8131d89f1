"""Studies with model = "plunger-map" and "static-map": simulated, fitted, refused."""

import numpy as np
import pytest
from commands import assert_refused, cut_example, read, run_command

import vgtjax
from calibrate.study.components import (
    FullComponents,
    MechanicalComponents,
    PlungerMapComponents,
    StaticMapComponents,
)
from calibrate.study.units import prepare

STATES = {
    "plunger-map": "x_p [m],v_p [m/s],x_d [m],v_d [m/s],z [m],p_act [Pa absolute],m_dot_in [kg/s],m_dot_out [kg/s]",
    "static-map": "x_d [m],v_d [m/s],z [m],p_act [Pa absolute],m_dot_in [kg/s],m_dot_out [kg/s]",
}
TRACE = '[[trace]]\nfile = "step_80.csv"\n'
STIFFER = '[parameters]\n"converter.membrane_stiffness" = {value = 2200}\n"diaphragm.stiffness" = {value = 11500}\n'


@pytest.fixture
def short(tmp_path):
    cut_example("step_80", 0.9, tmp_path)
    return tmp_path


def write(folder, text):
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def columns(path):
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    return dict(zip(header.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))


@pytest.mark.parametrize("model", STATES)
def test_simulate_takes_the_map_of_the_stated_converter(model, short):
    study = write(short, f'model = "{model}"\n{TRACE}{STIFFER}')
    assert run_command("simulate", study, "--out", short / "out").status == 0
    written = columns(short / "out" / "step_80.csv")
    assert ",".join(written) == f"time [s],pwm [%],p_res [Pa absolute],{STATES[model]}"
    full = vgtjax.replace_parameters(
        vgtjax.Actuator(), {"converter.membrane_stiffness": 2200.0, "diaphragm.stiffness": 11500.0}
    )
    reduce = {"plunger-map": vgtjax.reduce_to_plunger_map, "static-map": vgtjax.reduce_to_static_map}[model]
    run = vgtjax.simulate(reduce(full), vgtjax.load_trace(short / "step_80.csv"))
    np.testing.assert_allclose(written["p_act [Pa absolute]"], run.p_act, rtol=6e-9)  # nine digits are written
    np.testing.assert_allclose(written["x_d [m]"], run.x_d, rtol=6e-9, atol=1e-18)


def test_a_study_chooses_the_map_and_states_its_coefficients(short):
    study = write(
        short,
        f'model = "static-map"\n{TRACE}[components]\nflow_map = "polynomial"\n'
        '[parameters]\n"flow_map.duty[0]" = {value = -4.6e-6}\n',
    )
    model = prepare(study, None).units[0].model
    fitted = vgtjax.fit_flow_map(vgtjax.Actuator(), "polynomial").flow_map
    assert float(model.flow_map.duty[0]) == -4.6e-6
    assert float(model.flow_map.duty[1]) == float(fitted.duty[1])
    assert prepare(study, None).study.components.flow_map == "polynomial"


@pytest.mark.parametrize("model", STATES)
def test_a_fit_moves_neither_the_map_nor_what_it_replaced(model, short):
    job = prepare(write(short, f'model = "{model}"\n{TRACE}'), None)
    free = vgtjax.select(job.units[0].model, free=job.study.fit.free, fixed=job.study.fit.fixed).entries
    assert "diaphragm.stiffness" in free
    assert ("converter.plunger_damping" in free) == (model == "plunger-map")
    assert not [entry for entry in free if "flow_map" in entry or "orifice" in entry]


def test_a_fit_of_four_states_finds_the_spring_and_reads_back(tmp_path):
    """Without a plunger, to a trace of the same model with another spring and preload."""
    truth = vgtjax.replace_parameters(
        vgtjax.StaticMapActuator(), {"diaphragm.stiffness": 11000.0, "diaphragm.preload": 47.0}
    )
    time = np.arange(0, 0.9, 1e-3)
    trace = vgtjax.Trace(time, pwm=np.where(time > 0.1, 65.0, 0.0), p_res=np.full_like(time, 2e4))
    run, noise = vgtjax.simulate(truth, trace), np.random.default_rng(0)
    rows = np.stack(
        [
            time,
            trace.pwm,
            run.p_act + noise.normal(0, 100, time.shape),
            trace.p_res,
            run.x_d * 1e3 + noise.normal(0, 0.01, time.shape),
        ],
        axis=1,
    )
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
    (tmp_path / "step.csv").write_text(f"time [s],pwm [%],p_act [Pa absolute],p_res [Pa absolute],x_d [mm]\n{text}\n")
    study = write(
        tmp_path,
        'model = "static-map"\n[[trace]]\nfile = "step.csv"\n'
        '[fit]\nfree = ["diaphragm.stiffness", "diaphragm.preload"]\n',
    )
    outcome = run_command("fit", study, "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    parameters = read(tmp_path / "out" / "parameters.json")
    assert parameters["model"] == "static-map"
    found = {name: parameters["parameters"][name] for name in ("diaphragm.stiffness", "diaphragm.preload")}
    for name, value in (("diaphragm.stiffness", 11000.0), ("diaphragm.preload", 47.0)):
        # Four standard errors, of a seed that is fixed.
        assert abs(found[name]["value"] - value) < 4 * found[name]["std_error"]
    again = prepare(study, tmp_path / "out" / "parameters.json").units[0].model
    assert float(again.diaphragm.stiffness) == found["diaphragm.stiffness"]["value"]


ALL = {"friction": "lugre", "vane_force": "none", "line": "none", "magnetic_force": "static", "chamber": "adiabatic"}


@pytest.mark.parametrize("components", [FullComponents, MechanicalComponents, PlungerMapComponents])
def test_files_of_all_models_state_the_same_components(components):
    assert components().names() == ALL


def test_a_map_is_stated_where_there_is_one():
    assert StaticMapComponents(flow_map="printed").names() == {**ALL, "flow_map": "printed"}


BAD = {
    "a map in the full model": (
        f'{TRACE}[components]\nflow_map = "printed"\n',
        "the key 'components.flow_map' belongs to model = 'plunger-map' or 'static-map', but it is 'full'; "
        "remove the key",
    ),
    "a map that there is not": (
        f'model = "static-map"\n{TRACE}[components]\nflow_map = "polynomal"\n',
        "components.flow_map must be one of steady-plunger, polynomial, printed, but it is 'polynomal'; "
        "did you mean 'polynomial'?",
    ),
    "a map over duty for a plunger": (
        f'model = "plunger-map"\n{TRACE}[components]\nflow_map = "printed"\n',
        "with model = 'plunger-map', components.flow_map can only be 'table', but it is 'printed'; remove it",
    ),
    "a line": (
        f'model = "static-map"\n{TRACE}[components]\nline = "delay"\n',
        "with model = 'static-map', components.line can only be 'none', but it is 'delay'; remove it",
    ),
    "a line on a rod alone": (
        f'model = "mechanical"\n{TRACE}[components]\nline = "wave"\n',
        "with model = 'mechanical', components.line can only be 'none', but it is 'wave'; remove it",
    ),
    "heat": (
        f'model = "plunger-map"\n{TRACE}[components]\nchamber = "adiabatic"\n',
        "with model = 'plunger-map', components.chamber can only be 'isothermal', but it is 'adiabatic'; remove it",
    ),
    "bounds of what the map replaced": (
        f'model = "static-map"\n{TRACE}[parameters]\n"converter.plunger_damping" = {{lower = 10}}\n',
        "'converter.plunger_damping' only shapes the flow map of model = 'static-map', so it has a value and no "
        "bounds; remove them",
    ),
    "a wrong name": (
        f'model = "static-map"\n{TRACE}[parameters]\n"converter.membrane_stifness" = {{value = 10}}\n',
        "parameter name or pattern 'converter.membrane_stifness' matches nothing; did you mean "
        "'converter.membrane_stiffness'? (see [parameters] in the study)",
    ),
    "a value that is not physical": (
        f'model = "static-map"\n{TRACE}[parameters]\n"converter.membrane_stiffness" = {{value = -1}}\n',
        "'converter.membrane_stiffness' must be finite and not negative, but it is -1; correct it (see "
        "[parameters] in the study)",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_a_reduced_model_does_not_have_is_refused(case, short):
    text, sentence = BAD[case]
    outcome = run_command("simulate", write(short, text), "--out", short / "out")
    assert_refused(outcome, f"study.toml: {sentence}", short / "out")
