"""Hysteresis loops read from runs whose width is known."""

import numpy as np
import pytest

import vgtjax
from vgtjax.experiments import POSITIONS, find_ends, find_loop, measure_loops
from vgtjax.experiments._loops import LIFT


def run(width=2000.0, seconds=10.0, peak=10e-3, noise=0.0, samples=1000):
    """A rod pulled out and back between two straight branches, `width` Pa apart."""
    time = np.linspace(0, seconds, samples)
    x_d = peak * np.minimum(1, 1.2 * (1 - np.abs(2 * time / seconds - 1)))
    closing = time < seconds / 2
    p_act = 8.5e4 - 4e6 * x_d + np.where(closing, -0.5, 0.5) * width
    rng = np.random.default_rng(3)
    return time, x_d + noise * 8e-6 * rng.normal(size=samples), p_act + noise * 60 * rng.normal(size=samples)


def test_width_of_straight_branches_is_exact():
    loop = find_loop(*run())
    np.testing.assert_allclose(loop.width, 2000.0, rtol=1e-9)
    np.testing.assert_allclose(loop.closing, 8.5e4 - 4e6 * loop.position - 1000.0, rtol=1e-9)


@pytest.mark.parametrize("gap", [(4e-3, 6e-3), (1.7e-3, 2.6e-3), (7.7e-3, 8.4e-3)])
def test_a_rod_that_jumps_is_read_straight_over_the_gap(gap):
    """Also over an end of the span."""
    time, x_d, p_act = run()
    seen = (x_d < gap[0]) | (x_d > gap[1])
    loop = find_loop(time[seen], x_d[seen], p_act[seen])
    np.testing.assert_allclose(loop.closing, 8.5e4 - 4e6 * loop.position - 1000.0, rtol=1e-9)  # rounding


@pytest.mark.parametrize(("sticks", "slips"), [(3.3e-3, 4.49e-3), (3.7e-3, 4.9e-3), (1.2e-3, 2.49e-3)])
def test_a_rod_that_slips_and_waits_next_to_a_knot_is_read_within_what_it_jumped(sticks, slips):
    """Samples that lie close together next to a knot tell its height times a lever of fifty: it was 30 kPa off."""
    time, x_d, p_act = run(samples=3000)
    closing = time < time[-1] / 2
    jumps = closing & (x_d > sticks) & (x_d < slips)
    loop = find_loop(time, np.where(jumps, slips, x_d), p_act)
    there = 8.5e4 - 4e6 * loop.position - 1000.0
    missing = 4e6 * (slips - sticks)
    assert np.max(np.abs(loop.closing - there)) < 1.1 * missing
    # Half of it, where it waits with the pressure on its way, over the jump and an interval of knots.
    assert loop.mean_width == pytest.approx(2000.0, abs=0.5 * missing * (slips - sticks + 5e-4) / 6e-3)


def test_noise_averages_out():
    # Eight micrometres are 32 Pa here; about 15 samples a knot on each branch, 25 positions in the mean.
    assert find_loop(*run(noise=1.0)).mean_width == pytest.approx(2000.0, abs=15.0)


@pytest.mark.parametrize("case", [{"peak": 5e-3}, {"seconds": 0.5}])
def test_what_is_no_slow_loop_is_none(case):
    assert find_loop(*run(**case)) is None


def test_a_run_that_visits_the_span_twice_is_none():
    _, x_d, p_act = run()
    twice = np.concatenate([x_d, x_d])
    assert find_loop(np.linspace(0, 20, 2000), twice, np.concatenate([p_act, p_act])) is None


def rested(width=2000.0, noise=0.0, offset=0.0, samples=3000, pressed=5e3):
    """A rod that rests, is pulled out, is pressed into a stop at the top and comes back; its chamber starts vented."""
    time = np.linspace(0, 30, samples)
    way = np.interp(time, [0, 3, 13, 15, 25, 30], [0, 0, 1, 1, 0, 0])
    closing = time < 14
    p_act = -1.5e4 - 10e-3 * 4e6 * way + np.where(closing, -0.5, 0.5) * width
    p_act = p_act - pressed * np.interp(time, [13, 14, 15], [0, 1, 0])
    p_act = np.where(way > 0, p_act, np.where(closing, 0.0, -8e3))
    rng = np.random.default_rng(4)
    x_d = 10e-3 * way + offset + noise * 8e-6 * rng.normal(size=samples)
    return time, x_d, p_act + noise * 60 * rng.normal(size=samples)


@pytest.mark.parametrize("offset", [0.0, 50e-6, -50e-6])
def test_ends_of_a_straight_branch_are_exact_whatever_the_sensor_offset(offset):
    _, x_d, p_act = rested(offset=offset)
    start, end = find_ends(x_d, p_act)
    assert start == pytest.approx(-1.6e4 - 4e6 * LIFT, rel=1e-9)
    assert end == pytest.approx(-1.6e4 - 4e6 * (10e-3 - LIFT), rel=1e-9)


def test_ends_stand_noise():
    _, x_d, p_act = rested(noise=1.0)
    start, end = find_ends(x_d, p_act)
    # Noise of 8 um is 32 Pa here: five samples of rest and the twenty of the line leave 20 Pa; four times that. The
    # highest mean of five among noisy ones lies 8 um too high.
    assert start == pytest.approx(-1.6e4 - 4e6 * LIFT, abs=80.0)
    assert end == pytest.approx(-1.6e4 - 4e6 * (10e-3 - LIFT), abs=80.0 + 32.0)


def test_a_rod_that_turns_back_before_its_stop_has_no_end():
    _, x_d, p_act = rested(pressed=0.0)
    start, end = find_ends(x_d, p_act)
    assert np.isfinite(start)
    assert np.isnan(end)


def test_a_rod_that_stays_has_no_ends():
    assert np.isnan(find_ends(np.full(500, 1e-3), np.linspace(0, -1e4, 500))).all()


def loop_trace(turbine, width=2000.0, atmosphere=101013.0, position_offset=0.0, pressure_offset=0.0):
    time, x_d, p_act = rested(width, offset=position_offset)
    p_trb = None if turbine is None else np.full_like(time, turbine)
    p_act = p_act + atmosphere + pressure_offset
    return vgtjax.Trace(time, x_d=x_d, p_act=p_act, p_trb=p_trb, atmosphere=atmosphere)


def test_traces_are_taken_at_the_operating_point_that_is_within_50_mbar():
    traces = [loop_trace(2.951e5), loop_trace(1.549e5), loop_trace(-4.9e3), loop_trace(1.444e5)]
    # 1444 mbar is too far from 1500, so it is a point of its own, to 10 mbar.
    assert measure_loops(traces).turbine_pressures == (0.0, 1.44e5, 1.5e5, 3.0e5)
    assert measure_loops(traces, points=(1.47e5,)).turbine_pressures == (-5e3, 1.47e5, 1.55e5, 2.95e5)


def test_hysteresis_is_the_width_by_operating_point_and_the_first_of_two_counts():
    atmosphere = 9.7e4  # gauge pressures count from the bench's own atmosphere
    traces = [loop_trace(3e5, 4000.0, atmosphere), loop_trace(None, 2000.0, atmosphere), loop_trace(10.0, 999.0)]
    found = measure_loops(traces)
    assert found.hysteresis == pytest.approx({0.0: 2000.0, 3.0e5: 4000.0}, rel=1e-9)
    assert found.readings["start_pressure_0mbar"] == pytest.approx(-1.6e4 - 4e6 * LIFT, rel=1e-9)
    assert found.readings["closed_vane_effect_3000mbar_5mm"] == pytest.approx(-1000.0, rel=1e-9)
    assert repr(found).split()[-4:] == ["0", "20", "3000", "40"]


def test_offsets_of_the_sensors_do_not_count_as_effects_of_the_gas():
    """Loops that are the same but for what the sensors show at rest; the position counts from its mean over traces."""
    found = measure_loops(
        [
            loop_trace(0.0, position_offset=60e-6, pressure_offset=400.0),
            loop_trace(3e5, position_offset=-20e-6, pressure_offset=-700.0),
        ]
    )
    for position in (3, 5, 7):
        assert found.readings[f"closed_vane_effect_3000mbar_{position}mm"] == pytest.approx(0.0, abs=1e-5)  # rounding
        assert found.readings[f"open_vane_effect_3000mbar_{position}mm"] == pytest.approx(0.0, abs=1e-5)
    assert found.readings["closing_pressure_0mbar"] == pytest.approx(-1.6e4 - 4e6 * (POSITIONS - 20e-6), rel=1e-9)
    assert found.readings["start_pressure_3000mbar"] == pytest.approx(-1.6e4 - 4e6 * LIFT, rel=1e-9)


def test_a_step_beside_a_loop_has_no_say_in_where_the_rod_rests():
    alone = measure_loops([loop_trace(0.0)])
    time = np.linspace(0, 40, 4001)
    stepped = time > 0.2  # half of what counts as the rest of a loop as long as that
    step = vgtjax.Trace(time, x_d=np.where(stepped, 8.5e-3, 0.0), p_act=101013.0 - 5e4 * stepped)
    beside = measure_loops([step, loop_trace(0.0)])
    assert beside.hysteresis == alone.hysteresis
    np.testing.assert_array_equal(beside.readings["closing_pressure_0mbar"], alone.readings["closing_pressure_0mbar"])


def test_loops_are_read_from_channels_with_clocks_of_their_own():
    """Position at 200 Hz with a gap, pressure at 100 Hz and 3 ms late, the turbine once a second."""
    time, x_d, p_act = rested(samples=6001)
    seen = (time < 8) | (time > 8.1)
    late = np.arange(0.003, 29.9, 0.01)
    trace = vgtjax.Trace(
        x_d=vgtjax.Channel(time, np.where(seen, x_d, np.nan), seen),
        p_act=vgtjax.Channel(late, np.interp(late, time, p_act) + 101013.0),
        p_trb=vgtjax.Channel(np.arange(31.0), np.full(31, 1.5e5)),
    )
    # All is straight between samples but the jumps of pressure, where the rod rests.
    assert measure_loops([trace]).hysteresis == pytest.approx({1.5e5: 2000.0}, rel=1e-9)


def test_a_unit_without_loops_has_no_readings():
    time, x_d, p_act = rested()
    step = vgtjax.Trace(time / 60, x_d=x_d, p_act=1e5 + p_act)
    assert measure_loops([step, vgtjax.Trace(time, x_d=x_d), vgtjax.Trace(time, p_act=1e5 + p_act)]) is None
    assert measure_loops([]) is None
