"""The limits of identification, and how a bench test that is not possible, or a result, shows itself."""

import pathlib
import re

import numpy as np
import pytest

import vgtjax
from vgtjax import SimulationError
from vgtjax.identification import LIMITS, identify_mass_and_damping, identify_spring

SOURCES = [
    path.read_text(encoding="utf-8")
    for path in (pathlib.Path(vgtjax.__file__).parent / "identification").rglob("*.py")
    if path.name != "_limits.py"
]


@pytest.mark.parametrize("name", LIMITS)
def test_every_limit_is_used_and_has_a_reason(name):
    limit = LIMITS[name]
    assert limit > 0
    assert len(limit.reason) > 10
    assert any(re.search(rf"\blimits\.{name}\b|_limits import .*\b{name}\b", source) for source in SOURCES)


@pytest.fixture(scope="module")
def moving():
    """Slow sines of the force on a rod without friction to speak of."""
    time = np.arange(0, 6, 1e-3)
    force = 110 + 55 * np.sin(2 * np.pi * 0.5 * time - np.pi / 2)
    trace = vgtjax.Trace(time=time, f_drive=force, x_d=np.zeros_like(time))
    run = vgtjax.simulate(vgtjax.MechanicalActuator(), trace)
    return trace.replace(x_d=np.asarray(run.x_d))


def test_a_result_prints_its_values_with_units(moving):
    found = identify_spring(vgtjax.MechanicalActuator(), [moving])
    lines = str(found).splitlines()
    assert lines[0] == "spring [2.36]"
    stiffness = next(line for line in lines if "diaphragm.stiffness" in line)
    value, error = found.values["diaphragm.stiffness"], found.std_errors["diaphragm.stiffness"]
    cells = ["diaphragm.stiffness", f"{value:.5g}", f"{error:.2g}", "N/m"]
    assert stiffness.split() == cells
    assert "diaphragm.travel: the rod does not rest at its closed stop" in str(found)
    assert "".join(f"<td>{cell}</td>" for cell in cells) in found._repr_html_()


def test_a_test_that_is_not_possible_says_why(moving, monkeypatch):
    nothing = identify_spring(vgtjax.Actuator(), [])
    assert (nothing.name, nothing.equations, nothing.values) == ("spring", "2.36", {})
    assert str(nothing).startswith("spring [2.36]: not possible\nthe rod never slides freely")

    def fails(*args):
        raise SimulationError("the simulation fails")

    monkeypatch.setattr("vgtjax.identification.mechanical._second_order.fit_response", fails)
    assert identify_mass_and_damping(vgtjax.MechanicalActuator(), [moving]).limitations == ("the simulation fails",)
