"""Fitted units as the actuators of a study."""

import numpy as np
import pytest
from support import EXAMPLE

import vgtjax
from calibrate.population import read_actuators
from calibrate.study.tables import AnyStudy

FLEET = EXAMPLE / "fleet" / "study.toml"
COMPONENTS = {"vane_force": "speed-map"}


def spreads(parameters: dict) -> tuple[vgtjax.AbstractModel, dict[str, float]]:
    """The nominal actuator, and how every quantity spreads."""
    study = AnyStudy.validate_python({"components": COMPONENTS, "parameters": parameters})
    found = read_actuators(FLEET, study, EXAMPLE / "fleet" / "units")
    population = found.population
    assert len(found.fitted) == 20
    return population.model, dict(zip(population.factors.entries, population.deviations.tolist(), strict=True))


def test_tables_and_their_errors_are_read_at_the_knots_that_a_study_states():
    """Those of the files are 1500 and 3000 mbar: values were read at the study's, errors were those of other knots."""
    plain, known = spreads({})
    pressures = [0.75e5, 1.5e5, 3.0e5]
    model, found = spreads({"vane_force.turbine_pressure": {"value": pressures}})
    np.testing.assert_array_equal(model.vane_force.turbine_pressure, pressures)
    table, more = (np.reshape(each.vane_force.closing, (-1, 6)) for each in (plain, model))
    np.testing.assert_allclose(more, np.vstack([0.5 * table[:1], table]), rtol=1e-9)
    # A table of zero at no pressure: half of its first row at half of that pressure, and as much of the spread.
    for k in range(18):
        size, at = (0.5, k) if k < 6 else (1.0, k - 6)
        # As many iterations, which settle to this.
        assert found[f"vane_force.closing[{k}]"] == pytest.approx(size * known[f"vane_force.closing[{at}]"], rel=1e-3)
