"""Turbines that can't be, and points at which there is no flow: each is refused in a sentence."""

import re

import numpy as np
import pytest
from support import quick_nozzle

from vgtjax import InputError, Turbine, replace_parameters
from vgtjax.parts.vane_force import _turbine


@pytest.fixture(scope="module")
def turbine():
    """What is refused here is so before its table is read."""
    with quick_nozzle():
        return Turbine()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"outlet_pressure": 5e5}, r"outlet_pressure must be below 4.5 bar absolute, .* it is 5 bar"),
        ({"linkage.closed_angle": -10.0}, "have no throat|must be"),
        ({"nozzle.volute_radius": 26e-3}, "reach into the volute; make nozzle.volute_radius larger"),
        ({"nozzle.height": -1e-3}, "height"),
    ],
)
def test_a_geometry_that_does_not_work_is_refused(turbine, values, message):
    with pytest.raises(InputError, match=message):
        replace_parameters(turbine, values)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"speed_ratio": np.nan}, "'vane_force.speed_ratio' must be finite and not negative, but it is nan"),
        ({"ambient_pressure": -1.0}, "'vane_force.ambient_pressure' must be finite and not negative, but it is -1"),
    ],
)
def test_what_is_no_number_is_refused_before_a_table_is_made(values, sentence, monkeypatch):
    def solved(*_):
        raise AssertionError("a table was made")

    monkeypatch.setattr(_turbine, "make_table", solved)
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}; correct it$"):
        Turbine(**values)


@pytest.mark.parametrize(
    ("point", "sentence"),
    [
        ((np.nan, 12.0), "total_pressure must be a positive pressure in Pa absolute, but it is nan; correct it"),
        ((2e5, np.inf), "crank_angle must be a finite angle in deg, but it is inf; correct it"),
        ((2e5, 80.0), "vanes at 119 deg must stand between 0 and 90 deg from the tangent; open them by another angle"),
    ],
)
@pytest.mark.parametrize("ask", [Turbine.flow, Turbine.rod_force])
def test_a_point_at_which_there_is_no_flow_is_refused(turbine, ask, point, sentence):
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        ask(turbine, *point)
