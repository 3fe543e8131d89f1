"""Traces that do not begin at rest: where they begin is found, and spoils no parameter."""

import numpy as np
import pytest
from known_truth import FREE, NOISE, TRUTH, bench
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.assurance import Truth
from vgtjax.estimation import Evaluated, Slopes, Unknown, calibrate, plan_task
from vgtjax.estimation.measurements._measured import white_sensors
from vgtjax.parameters import entry_names
from vgtjax.plants import AirPath, Initial, Instrumented

BEGIN = 0.16
"""s; while the rod moves, and the gas has cooled down by expanding."""
LONG = {"x_d": "position", "p_act": "pressure"}
STARTS = ("initial.x_d[0]", "initial.p_act[0]", "initial.T_act[0]")


def plan(traces, start_state):
    choices = Unknown(False, False, "white", "gaussian", numerics=False, start_state=start_state)
    return plan_task(vgtjax.Actuator(), traces, free=FREE, unknown=choices)


def scores(found):
    """Errors of the parameters in standard errors."""
    places = [found.task.selection.entries.index(entry) for entry in FREE]
    return (found.values[places] - [TRUTH[entry] for entry in FREE]) / found.std_errors[places]


@pytest.fixture(scope="module")
def rest():
    return bench(12)


@pytest.fixture(scope="module")
def cut():
    """A recording that somebody switched on late."""
    whole = bench(11)
    return whole.window(BEGIN, float(whole.time[-1]))


@pytest.fixture(scope="module")
def found(rest, cut):
    return calibrate(plan([rest, cut], "evidence"))


def test_parameters_are_right_although_a_trace_begins_while_the_rod_moves(found):
    assert found.converged
    assert set(STARTS) == set(found.instruments)
    assert found.uncertainty.scale == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(scores(found)) < 4)


def test_gas_is_as_warm_as_its_chamber_allows_in_any_plant(cut):
    """Of the same parts put together in another way as well."""
    chambers = ((vgtjax.AdiabaticChamber(), STARTS), (vgtjax.IsothermalChamber(), STARTS[:2]))
    for chamber, starts in chambers:
        for plant in (vgtjax.Actuator(chamber=chamber), vgtjax.plants.Plant(AirPath(chamber=chamber))):
            task = plan_task(plant, [cut], free=FREE, unknown=Unknown())
            assert {entry for entry in task.selection.entries if entry.startswith("initial.")} == set(starts)


@pytest.mark.parametrize("begin", [0.1, 0.13, 0.2])
def test_a_search_begins_near_where_a_trace_does(begin):
    """What is fitted begins 30 ms later, where the rod has gone a millimetre on, and its mean is later still."""
    whole = bench(13)
    task = plan([whole.window(begin, float(whole.time[-1]))], "evidence")
    place = int(np.searchsorted(whole.time, begin - 1e-6))
    guess = dict(zip(task.selection.entries, np.asarray(task.selection.pack(task.model)).tolist(), strict=True))
    for channel, away, near in (("x_d", 1e-3, 1e-4), ("p_act", 2e3, 1e3)):
        first = float(getattr(whole, channel)[place]) - getattr(task.fit[0].start(), LONG[channel])
        assert abs(first) > away
        assert abs(guess[f"initial.{channel}[0]"] - first) < near  # parabolas are no exact motion


def test_a_search_begins_at_the_mean_where_hardly_anything_moves():
    """Or where too few samples tell of it: at 50 Hz, three of the first 50 ms."""
    rng, time = np.random.default_rng(4), np.arange(0, 0.5, 1e-3)
    still = vgtjax.Trace(
        time,
        pwm=np.full(500, 40.0),
        x_d=2e-3 + rng.normal(0, NOISE["x_d"], 500),
        p_act=8e4 + rng.normal(0, NOISE["p_act"], 500),
    )
    ramp = vgtjax.Trace(time[::20], pwm=np.full(25, 40.0), x_d=0.02 * time[::20], p_act=8e4 - 2e4 * time[::20])
    for trace in (still, ramp):
        task = plan([trace], "evidence")
        guess = dict(zip(task.selection.entries, np.asarray(task.selection.pack(task.model)).tolist(), strict=True))
        assert [guess[entry] for entry in STARTS] == [0.0, 0.0, 0.0]


def test_the_start_state_is_found_with_its_error(cut, found):
    plant = vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH)
    run = simulate(plant, duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4))
    place = int(np.searchsorted(run.time, BEGIN - 1e-6))
    start = found.task.fit[1].start()
    read = {"x_d": float(start.position), "p_act": float(start.pressure), "T_act": float(plant.air.temperature)}
    for channel, value in read.items():
        difference, error = found.instruments[f"initial.{channel}[0]"]
        assert abs(difference) > 5 * error
        # What friction and plunger had stored is not free: worth a tenth of a millimetre, and as much of pressure.
        slack = {"x_d": 1e-4, "p_act": 1e3, "T_act": 2.0}[channel]
        assert abs(value + difference - float(getattr(run, channel)[place])) < 4 * error + slack


def test_read_from_the_signals_it_makes_parameters_wrong(rest, cut):
    blind = calibrate(plan([rest, cut], False))
    assert np.max(np.abs(scores(blind))) > 10  # measured: 14, with errors made eleven times wider by what is left over


def test_alone_such_a_trace_does_not_tell_where_the_position_counts_from(cut):
    """A shift of the position is one of preload, volume and sensor; a stop that the rod touches would tell."""
    found = calibrate(plan([cut], "evidence"))
    known = dict(zip(found.task.selection.entries, found.uncertainty.estimable.tolist(), strict=True))
    assert not known["diaphragm.preload"]
    assert known["diaphragm.stiffness"]


def test_a_trace_at_rest_has_no_start_to_find_unless_asked_for(rest, cut):
    both = plan([rest, cut], "evidence")
    assert [trace.start_number for trace in both.fit] == [0, 1]
    assert len(both.selection.entries) == len(FREE) + 3
    assert plan([rest], "evidence").selection.entries == plan([rest], False).selection.entries
    assert len(plan([rest], True).selection.entries) == len(FREE) + 3
    assert not plan([rest], True).fit[0].start().at_rest


def test_what_is_free_is_what_the_model_has(cut):
    """The pressure that drives a rod is kept whole, and gas of one temperature has no other to begin with."""
    rod = vgtjax.Trace(cut.time, p_act=cut.p_act, x_d=cut.x_d)
    free = plan_task(vgtjax.MechanicalActuator(), [rod], free=["diaphragm.preload"], unknown=Unknown(start_state=True))
    assert free.selection.entries == ("diaphragm.preload", "initial.x_d[0]")
    np.testing.assert_array_equal(free.fit[0].time, rod.time)
    cold = vgtjax.Actuator(chamber=vgtjax.IsothermalChamber())
    entries = plan_task(cold, [cut], free=["diaphragm.preload"]).selection.entries
    assert entries == ("diaphragm.preload",)
    entries = plan_task(cold, [cut], free=["diaphragm.preload"], unknown=Unknown()).selection.entries
    assert set(entries) == {"diaphragm.preload", "initial.x_d[0]", "initial.p_act[0]"}


def test_only_the_trace_with_its_number_begins_elsewhere(cut, actuator):
    plain = simulate(actuator, cut)
    behind = Instrumented(actuator, initial=Initial([0.0, 1e-4], [0.0, 500.0], [0.0, -20.0]))
    assert set(entry_names(vgtjax.parameter_table(behind))) >= {"initial.x_d[1]", "initial.p_act[1]"}
    moved = simulate(behind, cut.replace(start_number=2))
    differences = [float(getattr(moved, name)[0] - getattr(plain, name)[0]) for name in ("x_d", "p_act", "T_act")]
    np.testing.assert_allclose(differences, [1e-4, 500.0, -20.0], rtol=1e-9)  # rounding of 1e5 Pa
    for number in (0, 1):
        np.testing.assert_array_equal(simulate(behind, cut.replace(start_number=number)).x_d, plain.x_d)


def test_a_campaign_of_a_recovery_begins_where_its_trace_did(rest, cut):
    task = plan([rest, cut], "evidence")
    clean = [np.zeros((len(trace.time), 2)) for trace in task.fit]
    nothing = Slopes(np.zeros(0), Evaluated([], []), [])
    truth = Truth(task, clean, white_sensors(task.fit, task.channels), nothing)
    for trace, again in zip(task.fit, truth.campaign(0, 0).fit, strict=True):
        np.testing.assert_array_equal(again.time, trace.time)
        np.testing.assert_array_equal(again.rows("x_d"), trace.rows("x_d"))
        assert again.start_number == trace.start_number
