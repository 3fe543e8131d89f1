"""Which parts feel the exhaust gas."""

import numpy as np
import pytest

import vgtjax
from vgtjax.parts import feels_gas

MAP = vgtjax.HysteresisMap(closing=np.ones(12), opening=np.zeros(12))


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (vgtjax.Actuator(), False),
        (vgtjax.Actuator(vane_force=MAP), True),
        (vgtjax.Actuator(vane_force=vgtjax.SpeedMap()), True),
        (vgtjax.Actuator(vane_force=vgtjax.ForcePolynomial()), True),
        (vgtjax.Actuator(friction=vgtjax.AdaptiveLuGre()), True),
        (vgtjax.MechanicalActuator(friction=vgtjax.Dahl()), False),
        (vgtjax.MechanicalActuator(vane_force=MAP), True),
        (vgtjax.PneumaticActuator(), False),  # neither vanes nor friction
    ],
)
def test_gas_acts_by_the_vanes_or_by_friction_that_they_load(model, expected):
    assert feels_gas(model) is expected
