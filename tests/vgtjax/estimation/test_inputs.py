"""A measured pressure that drives a rod: its noise and its offset at rest spoil no parameter."""

import dataclasses
import itertools

import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.assurance import Truth
from vgtjax.estimation import Unknown, _finish, plan_task, run_alone, start_calibration
from vgtjax.estimation.derivatives import _evaluation as evaluation
from vgtjax.estimation.measurements._inputs import InputSensor
from vgtjax.identification.mechanical._motion import read_motion

TRUTH = {"diaphragm.mass": 0.7, "diaphragm.preload": 51.0, "friction.coulomb_force": 2.6, "friction.static_force": 2.9}
NOISE, OFFSET = 60.0, 150.0
"""Pa."""
CHOICES = Unknown(False, False, "white", "gaussian", numerics=False, start_state=False)


def recorded(seed, offset=OFFSET, noise=NOISE):
    trace, rng = (
        duty_trace((0, 0.2), (70, 0.35), (40, 0.3), (60, 0.3), (30, 0.3), p_res=2.0e4),
        np.random.default_rng(seed),
    )
    run = simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), trace, stepping=vgtjax.FixedStep(1e-4))
    count = len(trace.time)
    return trace.replace(
        p_act=np.asarray(run.p_act) + offset + rng.normal(0, noise, count),
        x_d=np.asarray(run.x_d) + rng.normal(0, 8e-6, count),
    )


def plan(trace, **changes):
    chosen = dataclasses.replace(CHOICES, **changes)
    return plan_task(vgtjax.MechanicalActuator(), [trace], free=list(TRUTH), unknown=chosen)


def scores(found):
    truth = [TRUTH[entry] for entry in found.task.selection.entries]
    return (found.values - truth) / found.std_errors


@pytest.fixture(scope="module")
def found():
    return start_calibration(plan(recorded(1))).run()


def test_parameters_are_right_within_their_errors(found):
    assert found.converged
    assert np.all(np.abs(scores(found)) < 4)


def test_as_recorded_it_makes_them_wrong(found):
    blind = start_calibration(plan(found.task.fit[0].replace(p_act=recorded(1).p_act), input_noise=False)).run()
    assert np.max(np.abs(scores(blind))) > 10
    assert "sensor of the drive" not in blind.budget.moved


@pytest.mark.parametrize("fails", [{1, 3, 4}, set(range(1, 6))])
def test_what_cant_be_simulated_with_fresh_noise_does_not_count_as_no_error(found, monkeypatch, fails):
    """Of six answers the first is the end itself, the others its repetitions; of these two are left, or none."""
    calibrator, answers = start_calibration(plan(recorded(1)), found.progress), itertools.count()

    def ask(question):
        answer = yield from evaluation.ask(question)
        if next(answers) not in fails:
            return answer
        return dataclasses.replace(answer, observed=[np.full_like(each, np.nan) for each in answer.observed])

    monkeypatch.setattr(_finish, "ask", ask)
    if len(fails) == 5:
        with pytest.raises(vgtjax.SimulationError, match="can't be simulated with a drive that is measured once more"):
            run_alone(_finish._moved_by_inputs(found.task, calibrator.minimiser))
        return
    moves = run_alone(_finish._moved_by_inputs(found.task, calibrator.minimiser))
    # Two draws tell a scale to a factor of three; with the others as zeros it would be 0.63 of what these say.
    slope = np.asarray(found.transform.slope(np.array(found.progress.coordinates)))
    ratio = np.linalg.norm(moves, axis=0) * slope / found.budget.moved["sensor of the drive"]
    assert moves.shape == (2, len(TRUTH))
    assert np.all((ratio > 1 / 3) & (ratio < 3))


def test_noise_and_offset_are_found(found):
    sensor = found.input_sensor(found.task.fit[0])
    assert sensor.noise == pytest.approx(NOISE, rel=0.1)  # a robust scale of 1450 samples
    assert abs(sensor.offset - OFFSET) < 4 * sensor.offset_error
    assert sensor.offset_error == pytest.approx(NOISE / np.sqrt(200), rel=0.15)  # 0.2 s of rest


def test_what_reading_leaves_open_is_in_the_errors(found):
    """Beside the noise of the position, and for friction the larger part."""
    part = found.budget.moved["sensor of the drive"]
    assert np.all(part > 0)
    place = found.task.selection.entries.index("friction.coulomb_force")
    assert part[place] > found.budget.noise[place]
    assert np.all(found.std_errors > part)


def test_an_offset_that_is_free_is_not_read_from_rest():
    sensor = plan(recorded(2), offset=("p_act",)).inputs[0]
    assert (sensor.offset, sensor.offset_error) == (0.0, 0.0)


def test_without_rest_nothing_is_known_of_an_offset():
    moving = recorded(2).window(0.3, 1.4)
    sensor = plan(moving).inputs[0]
    assert sensor == InputSensor(sensor.noise)
    assert sensor.noise == pytest.approx(NOISE, rel=0.1)


def test_a_stated_force_and_a_model_with_a_valve_are_read_as_recorded():
    trace = recorded(2)
    forced = trace.replace(f_drive=np.zeros(len(trace.time)), time=trace.time)
    assert plan(forced).inputs == [None]
    assert plan_task(vgtjax.Actuator(), [trace], free=["diaphragm.mass"], unknown=CHOICES).inputs == [None]


def test_campaigns_of_a_recovery_measure_the_pressure_anew(found):
    truth = run_alone(Truth.of(found.task, found.task.fit))
    first, second = (truth.campaign(number, 1).fit[0].p_act for number in (0, 1))
    left = np.std(first - found.task.fit[0].p_act)
    assert 0 < left < NOISE / 2  # what reading leaves of its noise
    assert np.any(first != second)


def test_a_clock_that_is_not_even_makes_no_difference():
    """Whole milliseconds at 600 Hz, and one sample less: noise and offset are read all the same."""
    trace = recorded(1)
    some = np.unique(np.round(np.arange(0, len(trace.time), 1e3 / 600)).astype(int))
    some = np.delete(some[some < len(trace.time)], 400)
    pressure = vgtjax.Channel(trace.time[some], trace.p_act[some])
    task = plan(trace.replace(p_act=pressure))
    sensor = task.inputs[0]
    assert sensor is not None
    assert sensor.noise == pytest.approx(NOISE, rel=0.15)  # by 700 third differences, of a signal whose steps differ
    assert abs(sensor.offset - OFFSET) < 4 * sensor.offset_error
    clean = np.asarray(simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), trace).p_act)[some]
    assert np.std(task.fit[0].channels["p_act"].value - clean) < 0.5 * NOISE


@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_a_chamber_that_does_not_rest_tells_no_offset(seconds):
    """Without a duty its fall looks like a rest of 50 ms; at zero duty it may still be vented from the run before."""
    trace = recorded(1, offset=0.0)
    if seconds:
        venting = 4e3 * np.exp(-np.arange(len(trace.time)) / 100.0)
        trace = trace.replace(p_act=trace.p_act - venting)
    else:
        trace = trace.window(0.2, 1.0).replace(pwm=None)
    assert plan(trace).inputs[0].offset == 0.0
    assert read_motion(vgtjax.MechanicalActuator(), trace).offset == 0.0


def test_a_gain_beside_an_offset_at_rest_is_that_of_the_difference_from_atmosphere():
    """Of a gauge sensor and of an absolute one alike; the preload was off by 3 N a percent."""
    truth = recorded(1)
    ambient = truth.atmosphere
    for shown in (ambient + 1.01 * (truth.p_act - ambient), 1.01 * truth.p_act):
        task = plan(truth.replace(p_act=shown), gain=("p_act",))
        model = vgtjax.replace_parameters(task.model, {"gain.p_act": 1.01})
        drive = task.fit[0].drive()
        there = model.true_drive(drive).chamber.start
        known = plan(truth).fit[0].drive().chamber.start
        np.testing.assert_allclose(there, known, atol=15.0)  # another noise level, another smoothing
