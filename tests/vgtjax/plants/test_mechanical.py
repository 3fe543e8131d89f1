"""The mechanical half alone."""

import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import FixedStep, MechanicalActuator, simulate


@pytest.fixture(scope="module")
def recorded(actuator):
    """A full simulation, recorded finely enough for its pressure to be an input."""
    trace = duty_trace((0, 0.05), (80, 0.5), (30, 0.4), (0, 0.4), interval=2.5e-4, p_res=2.0e4)
    run = simulate(actuator, trace)
    return vgtjax.Trace(time=trace.time, p_act=np.asarray(run.p_act), x_d=np.asarray(run.x_d))


def test_driven_by_the_full_models_pressure_it_moves_like_it(recorded):
    run = simulate(MechanicalActuator(), recorded)
    assert rms(run.x_d - recorded.x_d) < 2e-7  # pressure is linear between samples here


def test_a_force_that_equals_the_pressures_does_the_same(recorded):
    force = (101013.0 - recorded.p_act) * 2.9224e-3
    trace = vgtjax.Trace(time=recorded.time, f_drive=force, x_d=recorded.x_d)
    # A trace driven by force starts from its mean position; this one starts at rest there.
    run = simulate(MechanicalActuator(), trace)
    assert rms(run.x_d - recorded.x_d) < 1e-6
    np.testing.assert_allclose(run.f_drive, force)


def test_it_needs_an_input_and_a_position(recorded):
    with pytest.raises(vgtjax.InputError, match="needs the column p_act or f_drive, which is missing"):
        simulate(MechanicalActuator(), vgtjax.Trace(time=recorded.time, x_d=recorded.x_d))
    with pytest.raises(vgtjax.InputError, match="needs the column x_d, which is missing"):
        simulate(MechanicalActuator(), vgtjax.Trace(time=recorded.time, p_act=recorded.p_act))


def test_an_axis_without_spring_or_stops_moves_either_way():
    """Any second-order axis with friction: closed form under viscous friction alone."""
    time = np.arange(0, 1.0, 1e-3)
    axis = vgtjax.replace_parameters(
        MechanicalActuator(),
        {
            "diaphragm.mass": 2.0,
            "diaphragm.stiffness": 0.0,
            "diaphragm.preload": 0.0,
            "diaphragm.travel": np.inf,
            "diaphragm.stop_stiffness": 0.0,
            "friction.static_force": 1e-9,
            "friction.coulomb_force": 1e-9,
            "friction.bristle_stiffness": 1e-3,
            "friction.bristle_damping": 0.0,
            "friction.viscous_damping": 10.0,
        },
    )
    trace = vgtjax.Trace(time=time, f_drive=np.full_like(time, -3.0), x_d=np.full_like(time, -0.02))
    run = simulate(axis, trace, stepping=FixedStep(max_step=1e-4))
    exact = -0.02 - 0.3 * (time - (1 - np.exp(-5.0 * time)) / 5.0)
    np.testing.assert_allclose(run.x_d, exact, atol=1e-7)


def test_an_infinite_travel_has_no_stop_at_either_end():
    """A linear axis: positions of either sign, and nothing at zero to bump into."""
    axis = vgtjax.replace_parameters(
        vgtjax.MechanicalActuator(),
        {"diaphragm.travel": np.inf, "diaphragm.stiffness": 0.0, "diaphragm.preload": 0.0},
    )
    time = np.arange(2000) * 1e-3
    trace = vgtjax.Trace(time, f_drive=np.where(time < 1.0, -20.0, 20.0), x_d=np.zeros_like(time))
    run = vgtjax.simulate(axis, trace)
    mirrored = vgtjax.simulate(axis, vgtjax.Trace(time, f_drive=-trace.f_drive, x_d=np.zeros_like(time)))
    assert run.x_d.min() < -0.05  # m
    np.testing.assert_allclose(run.x_d, -mirrored.x_d, atol=1e-15)
