"""Slow traces are read both ways, as they cannot tell how their duty was held."""

import dataclasses

import numpy as np
import pytest
from known_truth import FREE, NOISE, TRUTH
from support import duty_trace

import vgtjax
from vgtjax.estimation import Unknown, plan_task, start_calibration
from vgtjax.estimation._finish import AS_LIKELY
from vgtjax.estimation.derivatives._programs import run_alone
from vgtjax.estimation.duty._readings import STUCK, _is_stuck, _unstuck, leaves_hold_open, reading_both_ways
from vgtjax.estimation.search._beginning import first_progress
from vgtjax.estimation.search._progress import quiet

CHOICES = Unknown(noise="white", loss="gaussian", numerics=False, start_state=False)


def ramp(*, louder=1.0, seed=3):
    """A duty that rises and falls by 90 % a second in lines, recorded at 100 Hz."""
    time, rng = 1e-3 * np.arange(2100), np.random.default_rng(seed)
    duty = 85 * np.clip(1 - np.abs(time - 1.0) / 0.95, 0, None)
    drive = vgtjax.Trace(time, pwm=duty, p_res=np.full_like(time, 2.0e4), duty_hold="linear")
    run = vgtjax.simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), drive)
    seen = {
        name: (np.asarray(getattr(run, name)) + rng.normal(0, louder * NOISE[name], len(time)))[::10]
        for name in ("x_d", "p_act")
    }
    return vgtjax.Trace(time[::10], pwm=duty[::10], p_res=drive.p_res[::10], name="ramp", **seen)


def task_of(*traces, **changes):
    return plan_task(vgtjax.Actuator(), traces, free=FREE, unknown=dataclasses.replace(CHOICES, **changes))


@pytest.fixture(scope="module")
def ended():
    """With so much noise that the traces can't tell."""
    return run_alone(start_calibration(task_of(ramp(louder=50.0))).ending())


def test_only_slow_traces_leave_the_hold_open():
    levels = duty_trace((0, 0.05), (70, 0.35), p_res=2.0e4).replace(x_d=np.zeros(400), p_act=np.full(400, 1e5))
    assert leaves_hold_open(task_of(ramp()))
    assert not leaves_hold_open(task_of(ramp(), levels))
    assert not leaves_hold_open(task_of(ramp(), duty_hold=False))


def test_both_readings_are_known_where_either_meets_the_traces(ended):
    progress = ended.minimiser.progress
    assert progress.hold_decided is False
    assert progress.otherwise
    other = run_alone(start_calibration(task_of(ramp(louder=50.0))).ending())
    assert other.minimiser.progress == progress  # nothing of it is chance


def test_how_far_values_differ_is_part_of_their_errors(ended):
    found = ended.finish()
    here, there = np.array(found.progress.coordinates), np.array(found.progress.otherwise)
    units = np.asarray(found.transform.slope(here))
    part = (np.sqrt(AS_LIKELY) * units * (there - here))[: len(found.values)]
    np.testing.assert_allclose(found.budget.moved["hold of the duty"], part, rtol=1e-9)
    alone = dataclasses.replace(found.progress, otherwise=())
    ended.minimiser.progress, kept = alone, ended.minimiser.progress
    without = ended.finish()
    ended.minimiser.progress = kept
    for one, other in zip(found.traces, without.traces, strict=True):  # which either reading meets
        np.testing.assert_allclose(one.channels["x_d"].error, other.channels["x_d"].error, rtol=1e-6)
    np.testing.assert_allclose(found.std_errors**2 - without.std_errors**2, part**2, rtol=1e-6)


def test_a_reading_that_is_out_of_the_question_is_no_part_of_errors():
    found = run_alone(start_calibration(task_of(ramp())).ending()).minimiser.progress
    assert found.linear == (1e-2,)
    assert found.otherwise == ()
    assert found.hold_decided


def test_a_search_that_was_stuck_begins_again_where_the_other_reading_ended(ended):
    """One that has not left its start, far above the noise, is as stuck as any."""
    stuck = start_calibration(task_of(ramp(louder=50.0)))
    stuck.minimiser.progress = dataclasses.replace(stuck.minimiser.progress, history=(STUCK * 2.0,))
    assert _is_stuck(stuck, ended)
    found = run_alone(_unstuck(stuck, ended)).minimiser.progress
    assert (found.linear, found.late) == (stuck.minimiser.progress.linear, False)
    # Either reading meets these traces.
    assert found.searched == pytest.approx(ended.minimiser.progress.searched, rel=0.02)
    assert run_alone(_unstuck(ended, stuck)) is ended


def test_a_fit_that_knows_both_does_not_ask_again(ended):
    again = start_calibration(ended.task, ended.minimiser.progress)
    assert run_alone(again.ending()).minimiser.progress == ended.minimiser.progress


@pytest.mark.parametrize("duty_delay", ["evidence", True])
def test_a_duty_that_would_come_early_was_linear_unless_its_delay_is_to_be_found(duty_delay):
    task = task_of(ramp(), duty_delay=duty_delay)
    late = dataclasses.replace(first_progress(task), late=True)
    early = run_alone(start_calibration(task, late).searching_from(late, quiet))
    assert early.minimiser.progress.coordinates[-1] == pytest.approx(-5.0, abs=0.5)  # ms: half a sample
    read = run_alone(reading_both_ways(early, quiet)).minimiser.progress
    if duty_delay is True:
        assert read == early.minimiser.progress
    else:
        assert (read.linear, read.late, read.otherwise, read.hold_decided) == ((1e-2,), False, (), True)
