"""An axis that a force drives: force and position alone tell it, and a record that begins in motion is noticed."""

import numpy as np
import pytest
from axis import axis
from support import assert_recovered

import vgtjax
from vgtjax.identification import identify_axis
from vgtjax.identification.mechanical._axis import moves_at_start
from vgtjax.identification.mechanical._axis_regression import regress_axis
from vgtjax.identification.mechanical._motion import read_motions

AXIS = {
    "diaphragm.mass": 1.8,
    "diaphragm.preload": -1.2,
    "friction.coulomb_force": 2.5,
    "friction.viscous_damping": 9.0,
}


def sweep(seed):
    """Record of an axis under a sum of sines about its constant force, at 1 kHz for 6 s."""
    time = np.arange(0, 6, 1e-3)
    random = np.random.default_rng(seed)
    lines = zip((0.5, 1.3, 2.9, 4.7), (6.0, 8.0, 8.0, 6.0), random.uniform(0, 2 * np.pi, 4), strict=True)
    force = -1.2 + sum(a * (np.sin(2 * np.pi * f * time + p) - np.sin(p)) for f, a, p in lines)
    trace = vgtjax.Trace(time=time, f_drive=force, x_d=np.zeros_like(time))
    real = vgtjax.replace_parameters(axis(vgtjax.Coulomb()), AXIS)
    return trace.replace(x_d=np.asarray(vgtjax.simulate(real, trace).x_d) + random.normal(0, 8e-6, len(time)))


def test_a_driven_axis_is_determined_by_force_and_position_alone():
    record = sweep(5)
    assert np.min(record.x_d) < -0.02
    result = identify_axis(axis(vgtjax.Coulomb()), [record])
    assert_recovered(result, AXIS, dict.fromkeys(AXIS, 0.02))
    assert result.limitations == ()


def test_a_record_that_begins_in_motion_is_noticed():
    record = sweep(5)
    assert moves_at_start(record) is None
    speed = np.gradient(record.x_d, record.time)
    begin = int(np.argmax(np.abs(np.convolve(speed, np.ones(20) / 20, "same"))))
    moving = moves_at_start(record.window(record.time[begin], 6.0))
    assert moving is not None
    assert moving[0] == pytest.approx(abs(np.mean(speed[begin : begin + 20])), rel=0.1)
    assert record.time[begin] < moving[1] < 6.0


def test_a_push_from_rest_is_no_motion():
    time = np.arange(0, 1, 1e-3)
    noise = np.random.default_rng(9).normal(0, 8e-6, len(time))
    pushed = vgtjax.Trace(time=time, f_drive=np.full_like(time, 60.0), x_d=15 * time**2 + noise)
    assert moves_at_start(pushed) is None


@pytest.mark.parametrize("friction", [vgtjax.Coulomb(), vgtjax.LuGre(), vgtjax.PassiveLuGre()])
def test_an_axis_without_dry_friction_is_identified(friction):
    time = np.arange(0, 4, 1e-3)
    force = 8 * np.sin(2 * np.pi * 1.3 * time) + 6 * np.sin(2 * np.pi * 3.1 * time)
    trace = vgtjax.Trace(time=time, f_drive=force, x_d=np.zeros_like(time))
    smooth = {"friction.coulomb_force": 0.0, "friction.viscous_damping": 10.0}
    real = vgtjax.replace_parameters(axis(vgtjax.Coulomb(), mass=0.5), smooth)
    noise = np.random.default_rng(3).normal(0, 8e-6, len(time))
    record = trace.replace(x_d=np.asarray(vgtjax.simulate(real, trace).x_d) + noise)
    model = vgtjax.replace_parameters(axis(friction), {"friction.coulomb_force": 0.0})
    free = ["diaphragm.mass", *[name for name in vgtjax.parameter_table(model) if name.startswith("friction.")]]
    free.remove("friction.coulomb_force")
    start = regress_axis(model, read_motions(model, [record]), free)
    assert start["diaphragm.mass"] == pytest.approx(0.5, rel=0.02)
    assert np.all(np.isfinite(list(start.values())))
