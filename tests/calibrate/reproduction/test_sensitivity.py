"""The whole mechanical model after a step, beside the frictionless response [4.4, corrected]."""

import numpy as np

import vgtjax
from calibrate.reproduction import sensitivity
from vgtjax.sensitivity import step_response


def test_dry_friction_holds_the_rod_back_by_no_more_than_its_peak():
    pressure = 2e4
    time, position = sensitivity.simulated_response(pressure)
    after = time > 0
    free = np.asarray(step_response(sensitivity.diaphragm(), pressure, time[after]))
    missing = free - position[after]
    assert np.all(missing > -1e-6)  # m; steps of 0.1 ms are off by 0.1 um
    # At rest the spring lacks what friction holds.
    held = float(vgtjax.LuGre().static_force / sensitivity.diaphragm().stiffness)
    assert 0.5 * held < missing[-1] < held
