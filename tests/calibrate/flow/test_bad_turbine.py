"""Turbines that don't work, in a study: one sentence and status 2 from every command, status 1 for a lost point."""

import jax.numpy as jnp
import numpy as np
import pytest
from commands import cut_example, run_command

from vgtjax.parts.vane_force import _stage_table

STUDY = """[components]
vane_force = "turbine"
[[trace]]
file = "step_50.csv"
"""
COMMANDS = ("flow", "fit", "simulate")


@pytest.fixture
def study(tmp_path):
    """Writes a study with one parameter, and gives its path."""
    cut_example("step_50", 0.2, tmp_path)

    def write(name, value):
        path = tmp_path / "study.toml"
        path.write_text(f'{STUDY}[parameters]\n"vane_force.{name}" = {{value = {value}}}\n')
        return path

    return write


@pytest.fixture
def solved(monkeypatch):
    """Tables that cost nothing, as no flow is what is looked at; which of their points were found."""
    found = np.ones((_stage_table.PRESSURES, _stage_table.ANGLES), bool)
    monkeypatch.setattr(_stage_table, "solve_table", lambda *_: (jnp.zeros((2, *found.shape)), jnp.asarray(found)))
    _stage_table._remembered.cache_clear()
    yield found
    _stage_table._remembered.cache_clear()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("nozzle.height", -1e-3, "'vane_force.nozzle.height' must be finite and not negative, but it is -0.001"),
        ("nozzle.rotor.outlet_area", 0.0, "rotor.outlet_area must be a positive size, but it is 0.0; a wheel without"),
        ("nozzle.rotor.outlet_angle", -95.0, "rotor.outlet_angle must be between -90 and 90 deg, but it is -95.0"),
        ("nozzle.thickness", 6e-3, "vanes at 4 deg have no throat, -5.11 mm; make them thinner or shorter"),
        ("linkage.closed_angle", 120.0, "vanes at 120 deg must stand between 0 and 90 deg from the tangent"),
        ("linkage.ratio", 4.0, "vanes at 64.5 deg reach into the wheel; make nozzle.trail shorter"),
        ("gas.constant", 0.0, "gas.constant must be a positive specific gas constant in J/(kg K), but it is 0.0"),
        ("gas.gamma", 0.9, "gas.gamma must be a ratio of heat capacities above 1, but it is 0.9"),
        ("total_temperature", 0.0, "vane_force.total_temperature must be a positive temperature in K, but it is 0.0"),
        ("outlet_pressure", 5e5, "vane_force.outlet_pressure must be below 4.5 bar absolute"),
    ],
)
def test_what_does_not_work_is_one_sentence(study, solved, tmp_path, command, name, value, sentence):
    outcome = run_command(command, study(name, value), "--out", tmp_path / "out")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.startswith(f"error: study.toml: {sentence}")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fit", "simulate"])
def test_a_point_that_is_not_found_is_named(study, solved, tmp_path, command):
    solved[12, 6] = False
    outcome = run_command(command, study("total_temperature", 950.0), "--out", tmp_path / "out")
    assert outcome.status == 1
    sentence = (
        "failed: no steady flow through the nozzle was found at 2.775 bar absolute and a crank angle of 12.25 deg: the "
        "search from the flow beside it failed; check"  # of the table alone, which is made up
    )
    assert outcome.err.startswith(sentence)
