"""Longer steps along slow traces in a fit that corrects for them, and a search that goes on without these."""

import dataclasses

import numpy as np
import pytest

import vgtjax
from vgtjax.assurance import _certificate, certified, certifying
from vgtjax.estimation import Unknown, plan_task, run_alone, start_calibration
from vgtjax.estimation.derivatives._steps import StepsOfFit, lengthens
from vgtjax.estimation.measurements._evidence import SETTLED

FREE = ["diaphragm.preload", "diaphragm.stiffness"]


def loop(interval=1e-2, duty_step=0.7):
    """A duty that rises slowly, simulated, with what a sensor would add."""
    time = np.arange(121) * interval
    pwm = np.minimum(25.0 + duty_step * np.arange(121), 95.0)
    trace = vgtjax.Trace(time, pwm=pwm, p_res=np.full(121, 2e4), name="loop")
    run, rng = vgtjax.simulate(vgtjax.Actuator(), trace), np.random.default_rng(4)
    x_d, p_act = run.x_d + rng.normal(0, 8e-6, 121), run.p_act + rng.normal(0, 60.0, 121)
    return vgtjax.Trace(time, pwm=pwm, p_res=np.full(121, 2e4), x_d=x_d, p_act=p_act, name="loop")


def substeps(trace):
    return int(StepsOfFit().plan(vgtjax.Actuator(), trace).substeps)


def test_slow_motion_that_is_sampled_rarely_takes_longer_steps():
    assert lengthens(vgtjax.Actuator(), loop())
    assert (substeps(loop()), substeps(loop(duty_step=2.0))) == (10, 20)
    assert not lengthens(vgtjax.Actuator(), loop(duty_step=2.0))
    assert not lengthens(vgtjax.Actuator(), loop(interval=4e-3))


def test_a_model_that_no_duty_drives_takes_no_longer_steps():
    trace = vgtjax.Trace(np.arange(3) * 1e-2, pwm=np.zeros(3), p_res=np.full(3, 2e4), p_act=np.full(3, 9e4))
    model = vgtjax.MechanicalActuator()
    assert not lengthens(model, trace)
    assert int(StepsOfFit().plan(model, trace).substeps) == 20


@pytest.fixture(scope="module")
def ended():
    return run_alone(start_calibration(plan_task(vgtjax.Actuator(), [loop()], free=FREE, unknown=Unknown())).ending())


def test_derivatives_that_pass_are_left_alone(ended):
    calibrator, certificate = run_alone(certified(ended))
    assert calibrator is ended
    assert certificate.passed
    assert ended.task.lengthens
    assert not ended.task.finer


def test_where_derivatives_fail_a_search_goes_on_with_shorter_steps(ended, monkeypatch):
    asked, seen = [], []

    def spoilt_once(calibrator):
        asked.append(calibrator)
        found = yield from certifying(calibrator)
        return dataclasses.replace(found, alone={FREE[0]: 1.0}) if len(asked) == 1 else found

    monkeypatch.setattr(_certificate, "certifying", spoilt_once)
    calibrator, certificate = run_alone(certified(ended, seen.append))
    assert certificate.passed
    assert asked == [ended, calibrator]
    progress = calibrator.minimiser.progress
    assert progress.finer
    assert all(each.finer for each in seen)
    assert progress.corrections
    steps = [int(each.minimiser.problem.bundles[0].plan.substeps) for each in (ended, calibrator)]
    assert steps == [10, 20]
    # Both correct for what their steps do, and end where a correction moves nothing by more than `SETTLED` errors.
    values = [run_alone(each.finishing()).values for each in (ended, calibrator)]
    errors = run_alone(calibrator.finishing()).std_errors
    np.testing.assert_allclose((values[1] - values[0]) / errors, 0.0, atol=2 * SETTLED)


def test_what_fails_with_shorter_steps_as_well_stays_failed(ended, monkeypatch):
    def spoilt(calibrator):
        return dataclasses.replace((yield from certifying(calibrator)), alone={FREE[0]: 1.0})

    monkeypatch.setattr(_certificate, "certifying", spoilt)
    calibrator, certificate = run_alone(certified(ended))
    assert not certificate.passed
    assert calibrator.task.finer


def test_a_fit_with_shorter_steps_goes_on_with_them(ended):
    progress = ended.minimiser.progress.refined()
    assert (progress.corrections, progress.converged, progress.finer) == (0, False, True)
    assert progress.coordinates == ended.minimiser.progress.coordinates
    again = run_alone(ended.at(progress))
    assert again.task.finer
    assert not again.task.lengthens
