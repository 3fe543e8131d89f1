"""A pulsation laid over a trace keeps what a slow sensor shows, and is what it was asked to be."""

import re

import numpy as np
import pytest

from vgtjax import Channel, InputError, Trace
from vgtjax.exhaust import Engine, PressurePulsation
from vgtjax.traces import STANDARD_ATMOSPHERE

TIME = np.arange(0, 1.2 + 1e-9, 0.01)  # ten cycles at 1000 rpm
SAMPLES = 40


def bench(pressure=50e3, **signals):
    duty = np.full_like(TIME, 40.0)
    return Trace(TIME, pwm=duty, x_d=1e-3 * TIME, p_trb=np.full_like(TIME, pressure), **signals)


@pytest.fixture(scope="module")
def engine(cycles):
    return PressurePulsation(np.asarray(cycles[1000].p_trb), 1000.0, 4)


def test_the_engines_pulsation_is_its_own_about_another_mean(engine, cycles):
    mean = float(np.mean(engine.pressure)) - STANDARD_ATMOSPHERE
    trace = engine.applied(bench(mean))
    pulsating = trace.channels["p_trb"]
    expected = np.interp(6000 * pulsating.time, cycles[1000].crank, engine.pressure, period=720) - STANDARD_ATMOSPHERE
    np.testing.assert_allclose(pulsating.value, expected, rtol=1e-12)  # rounding


def test_a_slow_sensor_shows_what_it_did(engine):
    values = engine.applied(bench()).p_trb
    # Whole cycles, of 160 and more samples each that lie elsewhere than those of the shape.
    assert np.mean(values[:-1]) == pytest.approx(50e3, rel=1e-4)
    assert np.ptp(values) > 10e3


def test_the_mean_may_move(engine):
    slope = bench().replace(p_trb=np.linspace(20e3, 80e3, len(TIME)))
    values = engine.applied(slope).p_trb
    half = len(values) // 2
    assert np.ptp(values[half:]) > 1.3 * np.ptp(values[:half])  # in proportion


def test_a_share_is_half_of_the_pulsation_from_peak_to_peak(engine):
    shared = PressurePulsation(engine.pressure, 1000.0, 4, share=0.2)
    assert 0.5 * np.ptp(shared.shape(STANDARD_ATMOSPHERE)) == pytest.approx(0.2)
    # The sharp valley before a blow-down lies between samples 0.75 ms apart.
    assert 0.5 * np.ptp(shared.applied(bench()).p_trb) == pytest.approx(0.2 * 50e3, rel=2e-2)


def test_its_clock_divides_that_of_the_trace_and_is_fine_enough(engine):
    trace = engine.applied(bench())
    pulsating = trace.channels["p_trb"]
    assert np.max(np.diff(pulsating.time)) <= 0.03 / SAMPLES * (1 + 1e-9)
    np.testing.assert_array_equal(trace.time, pulsating.time)
    assert np.all(np.isin(TIME, pulsating.time))
    assert len(trace.channels["x_d"].time) == len(trace.channels["pwm"].time) == len(TIME)
    np.testing.assert_array_equal(trace.at("pwm"), 40.0)


def test_a_fast_record_keeps_its_own_clock(engine):
    time = np.arange(0, 0.1, 5e-4)
    fast = Trace(time, x_d=np.zeros_like(time), p_trb=np.full_like(time, 50e3))
    np.testing.assert_array_equal(engine.applied(fast).time, time)


@pytest.mark.parametrize("trace", [bench(0.0), bench().replace(p_trb=None)], ids=["no gas", "no channel"])
def test_without_gas_nothing_changes(engine, trace):
    assert engine.applied(trace) is trace


def test_a_channel_with_a_hole_at_its_start_keeps_the_times_of_the_trace(engine):
    slow = Channel(TIME, np.full_like(TIME, 50e3), valid=TIME > 0.1)
    trace = bench().replace(p_trb=slow)
    disturbed = engine.applied(trace)
    assert disturbed.time[0] == trace.time[0]
    assert disturbed.channels["p_trb"].time[0] == pytest.approx(0.11)


def test_it_is_that_of_an_engine_at_a_point(engine, slow):
    made = PressurePulsation.of(Engine(), slow)
    np.testing.assert_array_equal(made.pressure, engine.pressure)
    assert (made.engine_speed, made.cylinders) == (1000.0, 4)
    assert made.firing_interval == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda p: PressurePulsation(p, 0.0, 4),
            "engine_speed must be a positive speed in rpm, but it is 0.0; correct it",
        ),
        (
            lambda p: PressurePulsation(p, 1000.0, 4, 1.5),
            "the share of a pulsation must lie between 0 and 1, but it is 1.5; choose e.g. 0.2",
        ),
        (
            lambda p: PressurePulsation(p - 5e4, 1000.0, 4).applied(bench()),
            "the engine's mean turbine pressure must be above the atmosphere of 101013 Pa, but it is 94343 Pa; raise "
            "its outlet_pressure, or give a share for the amplitude",
        ),
    ],
    ids=["speed", "share", "mean"],
)
def test_a_bad_pulsation_is_refused(engine, make, sentence):
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        make(engine.pressure)
