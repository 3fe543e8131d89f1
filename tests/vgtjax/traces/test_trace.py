"""Traces: channels on clocks of their own, the times that they share, and sentences about bad ones."""

import pickle

import jax
import numpy as np
import pytest

import vgtjax
from vgtjax.traces import SIGNALS, require

PWM = vgtjax.Channel([0.0, 0.01, 0.02], [0.0, 50.0, 20.0])
POSITION = vgtjax.Channel([0.001, 0.011, 0.021, 0.031], [1e-3, 2e-3, 3e-3, 4e-3])


def equal(first, second):
    """Whether two drives or starts are the same numbers."""
    pairs = zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True)
    return all(np.array_equal(one, other) for one, other in pairs)


def test_a_model_is_simulated_at_all_samples_of_all_channels_in_the_time_that_they_share():
    trace = vgtjax.Trace(pwm=PWM, x_d=POSITION)
    np.testing.assert_array_equal(trace.time, [0.001, 0.01, 0.011, 0.02, 0.021, 0.031])
    assert not trace.has_common_clock
    np.testing.assert_array_equal(trace.rows("x_d"), [0, 2, 4, 5])
    np.testing.assert_array_equal(trace.x_d, POSITION.value)
    assert trace.channels["x_d"].unit == "m"
    assert trace.longest_interval == pytest.approx(0.01)


def test_duty_is_held_and_pressures_are_linear_at_those_times():
    supply = vgtjax.Channel([0.0, 0.04], [2e4, 3e4])
    trace = vgtjax.Trace(pwm=PWM, x_d=POSITION, p_res=supply)
    drive = trace.drive()
    np.testing.assert_array_equal(drive.pwm, [0, 50, 50, 20, 20, 20])  # held on beyond its last sample
    np.testing.assert_array_equal(trace.jumps(), [1, 3])
    np.testing.assert_allclose(drive.reservoir.start, 2e4 + 1e4 * trace.time / 0.04)
    np.testing.assert_allclose(drive.reservoir.rate[:-1], 2.5e5)
    np.testing.assert_allclose(drive.duration, [0.009, 0.001, 0.009, 0.001, 0.01, 0.0])


def test_what_is_invalid_changes_nothing_whatever_it_holds():
    time = np.arange(20) * 1e-3
    valid = time != 0.004
    pressure, rubbish = 1e5 + 1e6 * time, np.where(valid, 1e5 + 1e6 * time, np.nan)
    marked = vgtjax.Trace(time, pwm=time, p_act=vgtjax.Channel(time, rubbish, valid))
    gone = vgtjax.Trace(time, pwm=time, p_act=vgtjax.Channel(time[valid], pressure[valid]))
    assert equal((marked.drive(), marked.start()), (gone.drive(), gone.start()))
    np.testing.assert_array_equal(marked.time, time)
    assert 4 not in marked.rows("p_act")
    assert len(marked.rows("p_act")) == 19


def test_invalid_ends_of_one_channel_take_nothing_from_the_others():
    time = np.arange(20) * 1e-3
    trace = vgtjax.Trace(time, pwm=time, x_d=time, p_act=vgtjax.Channel(time, time, (time > 0.003) & (time < 0.015)))
    np.testing.assert_array_equal(trace.time, time)
    assert len(trace.rows("x_d")) == 20
    np.testing.assert_array_equal(trace.rows("p_act"), range(4, 15))


def test_the_start_is_the_mean_of_each_channels_own_first_50_ms():
    slow, fast = np.arange(5) * 0.04, np.arange(160) * 1e-3 + 0.0005
    trace = vgtjax.Trace(
        pwm=vgtjax.Channel(slow, np.full(5, 30.0)),
        x_d=vgtjax.Channel(fast, np.where(fast < 0.0506, 2e-3, 9e-3)),
        p_act=vgtjax.Channel(slow, [9e4, 8e4, 1e4, 1e4, 1e4]),
    )
    start = trace.start()
    assert float(start.position) == pytest.approx(2e-3)
    # The first pressure lies before the position begins, so that of 40 ms is the first that counts.
    assert float(start.pressure) == pytest.approx((8e4 + 1e4) / 2, rel=1)
    assert not start.at_rest


def test_clocks_that_coincide_are_one_common_clock():
    time = np.arange(100) * 0.01
    rounded = time + np.where(np.arange(100) % 2, 1e-15, 0.0)
    signals = {"pwm": 10 * time, "x_d": 1e-3 * time, "p_act": 1e5 - time}
    plain = vgtjax.Trace(time, **signals)
    own = vgtjax.Trace(**{name: vgtjax.Channel(time, values) for name, values in signals.items()})
    near = vgtjax.Trace(**{**own.channels, "x_d": vgtjax.Channel(rounded, signals["x_d"])})
    for trace in (own, near):
        assert trace.has_common_clock
        assert equal((plain.drive(), plain.start()), (trace.drive(), trace.start()))
        np.testing.assert_array_equal(trace.time, time)
    assert plain.on_one_clock() is plain


def test_times_that_differ_by_rounding_begin_no_interval():
    duty = vgtjax.Channel([0.0, 0.1, 0.2], [0.0, 10.0, 20.0])
    trace = vgtjax.Trace(pwm=duty, x_d=vgtjax.Channel([0.0, 0.1 - 1e-15, 0.15, 0.2], np.zeros(4)))
    np.testing.assert_allclose(np.diff(trace.time), [0.1, 0.05, 0.05])
    np.testing.assert_array_equal(trace.drive().pwm, [0, 10, 10, 20])


def test_a_window_keeps_what_reaches_into_it():
    supply = vgtjax.Channel([0.0, 0.05], [2e4, 3e4])
    whole = vgtjax.Trace(pwm=PWM, x_d=POSITION, p_res=supply, name="run")
    part = whole.window(0.0105, 0.025)
    np.testing.assert_array_equal(part.time, [0.011, 0.02, 0.021])
    inside = slice(2, 5)
    np.testing.assert_array_equal(part.drive().pwm, whole.drive().pwm[inside])
    np.testing.assert_allclose(part.drive().reservoir.start, whole.drive().reservoir.start[inside])
    np.testing.assert_array_equal(part.sampled("x_d").value, [2e-3, 3e-3])
    again = part.window(0.0105, 0.025)
    assert equal(part.drive(), again.drive())
    with pytest.raises(vgtjax.InputError, match=r"run: the window \[0.011, 0.0115\] s must keep at least two samples"):
        whole.window(0.011, 0.0115)


def test_one_clock_is_that_of_the_slower_of_position_and_pressure():
    fast, slow = np.arange(101) * 1e-3, 0.0004 + np.arange(50) * 2e-3
    trace = vgtjax.Trace(
        pwm=PWM, x_d=vgtjax.Channel(fast, 1e-2 * fast), p_act=vgtjax.Channel(slow, 1e5 - slow), name="own"
    )
    pairs = trace.on_one_clock()
    assert pairs.has_common_clock
    assert pairs.name == "own"
    np.testing.assert_array_equal(pairs.time, slow)
    np.testing.assert_array_equal(pairs.p_act, 1e5 - slow)
    np.testing.assert_allclose(pairs.x_d, 1e-2 * slow)
    np.testing.assert_array_equal(pairs.pwm, np.select([slow >= 0.02, slow >= 0.01], [20.0, 50.0], 0.0))


def test_a_replaced_array_is_sampled_as_the_one_before():
    trace = vgtjax.Trace(pwm=PWM, x_d=POSITION, atmosphere=1e5)
    moved = trace.replace(x_d=POSITION.value + 1.0, p_trb=np.arange(6.0), name="moved")
    np.testing.assert_array_equal(moved.channels["x_d"].time, POSITION.time)
    np.testing.assert_array_equal(moved.channels["p_trb"].time, trace.time)
    assert (moved.name, moved.atmosphere) == ("moved", 1e5)
    assert moved.replace(p_trb=None).p_trb is None


def test_a_trace_is_a_value():
    trace = vgtjax.Trace(pwm=PWM, x_d=POSITION, name="run")
    with pytest.raises(AttributeError, match=r"can't be changed, so x_d can't be set; use trace.replace\(x_d=...\)"):
        trace.x_d = None
    copy = pickle.loads(pickle.dumps(trace))
    assert equal(copy.drive(), trace.drive())
    assert repr(trace) == "<Trace 'run' from 0.001 s to 0.031 s, samples: pwm (3), x_d (4)>"


def test_every_signal_of_a_trace_has_a_unit_in_the_table():
    recorded = {name for name, signal in SIGNALS.items() if signal.role != "state"}
    time = np.arange(3.0)
    trace = vgtjax.Trace(time, **dict.fromkeys(recorded, time))
    assert {name: channel.unit for name, channel in trace.channels.items()} == {
        name: SIGNALS[name].unit for name in recorded
    }


BAD = {
    "lengths": (
        lambda t: vgtjax.Trace(t, pwm=t[1:], name="run"),
        r"run: pwm: a signal must have one value per time, but value has shape \(9,\) against \(10,\) of time; give",
    ),
    "lengths of validity": (
        lambda t: vgtjax.Channel(t, t, [True]),
        r"one value per time, but value has shape \(10,\) against \(10,\) of time and \(1,\) of valid; give arrays",
    ),
    "tables": (lambda t: vgtjax.Trace(t, x_d=np.ones((10, 2))), r"x_d: a signal must have one value per time, but val"),
    "infinite": (
        lambda t: vgtjax.Trace(t, p_act=np.where(t == 3, np.inf, t)),
        "p_act: every valid sample must be a finite number, but the one at 3 s is inf; mark it invalid or remove it",
    ),
    "none valid": (
        lambda t: vgtjax.Trace(t, x_d=vgtjax.Channel(t, t, t < 0)),
        "at least one valid sample, but none of its 10 is; leave it out",
    ),
    "time stands still": (
        lambda t: vgtjax.Trace(np.minimum(t, 5.0), x_d=t),
        "x_d: time must be finite and increase strictly, but sample 6 is at 5 s after 5 s; sort the samples",
    ),
    "time unknown": (
        lambda t: vgtjax.Channel(np.where(t == 2, np.nan, t), t),
        "time must be finite and increase strictly, but sample 2 is at nan s after 1 s; sort the samples",
    ),
    "no clock": (lambda t: vgtjax.Trace(x_d=t), "x_d: an array needs the times of its samples, but none are given"),
    "nothing": (lambda t: vgtjax.Trace(), "a trace must have times, but there is no signal either; give time, or a"),
    "apart": (
        lambda t: vgtjax.Trace(pwm=vgtjax.Channel(t, t), x_d=vgtjax.Channel(t - 20, t), name="run"),
        "run: a trace must have at least two samples in the time that its signals share, but that runs from 0 s to "
        "-11 s; record more, or check the clocks",
    ),
    "one sample": (lambda t: vgtjax.Trace(t[:1], pwm=t[:1]), "must have at least two samples in the time that its sig"),
    "unit": (
        lambda t: vgtjax.Trace(x_d=vgtjax.Channel(t, t, unit="mm")),
        "x_d: the signal must be in m, but it is in mm; convert it",
    ),
    "drive ends": (
        lambda t: require(vgtjax.Trace(t, x_d=t, p_act=vgtjax.Channel(t, t, t < 5), name="run"), ("p_act|f_drive",)),
        "run: what drives this model must be valid from 0 to 9 s, but p_act is so from 0 to 4 s; cut the trace with a",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_trace_is_refused_in_one_sentence(case):
    make, sentence = BAD[case]
    with pytest.raises(vgtjax.InputError, match=sentence):
        make(np.arange(10.0))


def test_a_ramped_duty_is_that_of_its_own_samples_whatever_the_other_clocks():
    slow, fast = np.arange(0, 1.01, 0.1), np.arange(0, 1.001, 0.02)
    trace = vgtjax.Trace(pwm=vgtjax.Channel(slow, 100 * slow), x_d=vgtjax.Channel(fast, 0 * fast))
    ramped = trace.with_ramped_duty()
    drive, held = ramped.drive(), ramped.with_held_duty()
    np.testing.assert_allclose(drive.pwm, 100 * ramped.time, rtol=1e-12)  # rounding
    np.testing.assert_allclose(drive.pwm_rate[:-1], 100.0, rtol=1e-9)
    middles = 0.5 * (ramped.time[:-1] + ramped.time[1:])
    np.testing.assert_allclose(held.at("pwm")[:-1], 100 * middles, rtol=1e-12)
    np.testing.assert_array_equal(held.drive().pwm_rate, 0.0)
    np.testing.assert_array_equal(ramped.on_one_clock().pwm, held.on_one_clock().pwm)
    assert len(ramped.jumps()) == len(ramped.edges()) == 0


def test_a_late_duty_that_is_linear_between_samples_bends_at_times_of_its_own():
    time = 0.1 * np.arange(6)
    duty = np.array([0.0, 0.0, 50.0, 50.0, 20.0, -10.0]) + 10.0
    late = vgtjax.Trace(time, pwm=duty, x_d=0 * time, duty_hold="linear").with_late_duty(0.03)
    np.testing.assert_allclose(late.time, [0, 0.1, 0.13, 0.2, 0.23, 0.3, 0.33, 0.4, 0.5], atol=1e-12)
    np.testing.assert_allclose(late.at("pwm"), np.interp(late.time - 0.03, time, duty), atol=1e-9)
    np.testing.assert_array_equal(late.time[late.rows("x_d")], time)


def test_the_last_sample_of_a_duty_is_late_too_as_it_is_held_to_the_end():
    time = 0.001 * np.arange(2001)
    duty = vgtjax.Channel(np.array([0.0, 0.5, 1.0]), np.array([0.0, 40.0, 70.0]))
    late = vgtjax.Trace(pwm=duty, x_d=vgtjax.Channel(time, 0 * time)).with_late_duty(0.004)
    np.testing.assert_allclose(late.time[late.jumps()], [0.504, 1.004], atol=1e-12)  # rounding
    assert late.at("pwm")[-1] == 70.0


def test_an_actuator_is_at_rest_until_a_duty_begins_to_rise():
    time = 0.01 * np.arange(20)
    fall = np.interp(time, [0, 0.02, 0.05, 0.2], [101013.0, 101013.0, 5e4, 5e4])
    ramped = vgtjax.Trace(time, pwm=np.minimum(np.maximum(time - 0.02, 0) * 8e3, 80), p_act=fall, duty_hold="linear")
    assert ramped.start().at_rest
    assert not ramped.replace(duty_hold="zero-order", pwm=np.where(time < 0.05, 0.0, 80.0)).start().at_rest
    rising = ramped.replace(pwm=80 * time)
    assert rising.start().at_rest
    assert not rising.replace(p_act=np.full_like(time, 5e4)).start().at_rest


def test_edges_come_at_times_of_their_own():
    """By hand: a record with 500 Hz whose duty rose 1 ms before its sample, fell on its own, and crept in between."""
    time = 2e-3 * np.arange(40)
    duty = np.repeat([0.0, 50.0, 20.0, 21.0, 22.0, 0.0], [10, 10, 1, 1, 8, 10])
    trace = vgtjax.Trace(time, pwm=duty, x_d=np.zeros(40), p_res=np.full(40, 2e4))
    assert trace.edges().tolist() == [10, 30]
    moved = trace.with_late_edges([-1e-3, 0.0])
    assert len(moved.time) == len(time) + 2
    np.testing.assert_array_equal(moved.time[moved.rows_at(time)], time)
    assert moved.at("pwm", np.array([19.9e-3 - 1e-3, 19.1e-3])).tolist() == [0.0, 50.0]
    # On a sample that is there an edge comes a microsecond early, so that it is a time more.
    np.testing.assert_allclose(moved.time[moved.jumps()], [19e-3, 40e-3, 42e-3, 44e-3, 60e-3 - 1e-6], atol=1e-12)
    np.testing.assert_array_equal(moved.x_d, trace.x_d)
    integral = np.sum(moved.at("pwm")[:-1] * np.diff(moved.time)) - np.sum(duty[:-1] * np.diff(time))
    assert integral == pytest.approx(50.0 * 1e-3 - 22.0 * 1e-6, abs=1e-9)


def test_edges_pass_no_other():
    time = 2e-3 * np.arange(40)
    trace = vgtjax.Trace(time, pwm=np.repeat([0.0, 50.0, 0.0], [10, 5, 25]), x_d=np.zeros(40))
    moved = trace.with_late_edges([1.0, -1.0])
    np.testing.assert_allclose(moved.time[moved.jumps()], [24e-3, 26e-3], atol=2e-6)


def test_an_edge_at_the_beginning_stays_inside_of_the_trace():
    time = 2e-3 * np.arange(40)
    trace = vgtjax.Trace(time, pwm=np.repeat([0.0, 50.0], [1, 39]), x_d=np.zeros(40))
    moved = trace.with_late_edges([-3e-3])
    assert time[0] < moved.time[moved.jumps()][0] < 1e-5


def test_edges_before_the_other_channels_begin_change_nothing():
    """A duty that was recorded for longer: two of its edges are before the trace, one is in it."""
    clock = 1e-3 * np.arange(100)
    duty = vgtjax.Channel(clock, np.repeat([0.0, 50.0, 20.0, 70.0], [10, 10, 50, 30]))
    trace = vgtjax.Trace(pwm=duty, x_d=vgtjax.Channel(clock[50:], np.zeros(50)))
    moved = trace.with_late_edges([-5e-4, -5e-4, -5e-4])
    assert (moved.time[0], moved.time[-1]) == (trace.time[0], trace.time[-1])
    assert len(moved.time) == len(trace.time) + 1
    np.testing.assert_allclose(moved.time[moved.jumps()], [69.5e-3], atol=1e-12)


def test_edges_beside_a_delay():
    """By hand: edges at 20 and 60 ms, 3 ms late, of which the first was half a millisecond before its record."""
    time = 2e-3 * np.arange(40)
    trace = vgtjax.Trace(time, pwm=np.repeat([0.0, 50.0, 20.0], [10, 20, 10]), x_d=np.zeros(40))
    moved = trace.with_late_edges([-5e-4, 0.0], 3e-3)
    np.testing.assert_allclose(moved.time[moved.jumps()], [22.5e-3, 63e-3], atol=1e-12)
    assert moved.duty_late == 3e-3
    assert moved.replace(name="again").duty_late == 3e-3
    assert trace.with_late_edges([0.0, 0.0]).duty_late == 0.0


def test_a_duty_that_also_jumps_elsewhere_is_not_moved_as_a_whole():
    """By hand: three jumps within six samples, as of a ramp, have no times of their own; the edge before them has."""
    time, duty = 2e-3 * np.arange(60), np.zeros(60)
    duty[20:] = 50.0
    for number in (40, 42, 44):
        duty[number:] += 10.0
    moved = vgtjax.Trace(time, pwm=duty, x_d=np.zeros(60)).with_late_edges([1e-3], 3e-3)
    np.testing.assert_allclose(moved.time[moved.jumps()], [41e-3, 80e-3, 84e-3, 88e-3], atol=1e-12)
    assert moved.duty_late == 0.0


def test_edges_that_are_later_than_a_trace_is_long_stay_in_it():
    time = 2e-3 * np.arange(40)
    trace = vgtjax.Trace(time, pwm=np.repeat([0.0, 50.0, 20.0], [28, 6, 6]), x_d=np.zeros(40))
    moved = trace.with_late_edges([0.0, 0.0], 50e-3)
    assert len(moved.jumps()) == 2
    assert np.all(np.diff(moved.time) > 0)
    assert moved.time[-1] == time[-1]
