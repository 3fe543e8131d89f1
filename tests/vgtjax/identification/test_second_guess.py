"""What traces tell directly, beside other values that are far off."""

import numpy as np
import pytest
from axis import axis, pull
from support import EXAMPLE

import vgtjax
from vgtjax.identification import plan_fit
from vgtjax.identification._second_guess import second_guess

FOUND = {"diaphragm.preload": 51.9, "diaphragm.stiffness": 12220.0, "diaphragm.travel": 0.010161}
"""What a fit of all traces gives."""
FAR = {
    "diaphragm.travel": 0.015,
    "diaphragm.stiffness": 9000.0,
    "diaphragm.preload": 90.0,
    "diaphragm.mass": 0.3,
    "friction.coulomb_force": 6.0,
    "converter.membrane_stiffness": 4000.0,
    "converter.magnetic_force": 0.6 * np.asarray(vgtjax.Actuator().converter.magnetic_force.coefficients),
}


@pytest.fixture(scope="module")
def traces():
    return [vgtjax.load_trace(EXAMPLE / f"{name}.csv") for name in ("step_100", "levels_1")]


@pytest.mark.parametrize("model", [vgtjax.Actuator(), vgtjax.Plant(), vgtjax.MechanicalActuator()])
def test_springs_and_travel_are_seen_from_afar(traces, model):
    known = vgtjax.parameter_table(model)
    far = vgtjax.replace_parameters(model, {name: value for name, value in FAR.items() if name in known})
    told = second_guess(far, traces)
    # Weighted regressions of filtered signals: a thousandth of the spring, friction's doubt on the preload.
    for name, value in FOUND.items():
        assert told[name] == pytest.approx(value, rel=0.01)
    assert set(told) - set(FOUND) == {"converter.magnetic_force"} & set(known)


def test_the_magnetic_force_hardly_depends_on_the_other_values(traces):
    duty = np.array([40.0, 60.0, 80.0])[:, None] ** np.arange(5)
    near = second_guess(vgtjax.Actuator(), traces)["converter.magnetic_force"]
    far = second_guess(vgtjax.replace_parameters(vgtjax.Actuator(), FAR), traces)["converter.magnetic_force"]
    np.testing.assert_allclose(duty @ far, duty @ near, rtol=0.1)


def test_what_has_no_such_thing_is_told_nothing():
    time = np.arange(0, 1, 1e-3)
    driven = axis(vgtjax.LuGre())
    assert second_guess(driven, [pull(time, 10 * np.sin(6 * time))]) == {}
    resting = vgtjax.Trace(time=time, pwm=0 * time, p_act=0 * time + 101325.0, p_res=0 * time + 2e4, x_d=0 * time)
    assert second_guess(vgtjax.Actuator(), [resting]) == {}


def test_every_fit_has_it(traces):
    assert plan_fit(vgtjax.Actuator(), traces).second_guess is second_guess
