"""Vane-force tables and surface from simulated benches whose truth is known."""

import numpy as np
import pytest

import vgtjax
from vgtjax import ForcePolynomial, HysteresisMap, SpeedMap, simulate
from vgtjax.identification import apply, identify_vane_map, identify_vane_polynomial, plan
from vgtjax.identification.mechanical._vane_force import _count_pressures

CLOSING = np.outer([1.0, 2.0], np.linspace(2.6, 1.3, 6)).ravel()
OPENING = np.outer([1.0, 1.9], np.linspace(-1.9, -0.8, 6)).ravel()
TRUE = HysteresisMap(closing=CLOSING, opening=OPENING)
EMPTY = vgtjax.Actuator(vane_force=HysteresisMap())


def bench(model, turbine, seed, sensor=False, noise=1.0):
    """A slow loop as a bench records it: 100 Hz, noisy, with an offset of every sensor."""
    time = np.arange(2001) * 1e-2
    duty = 100 * np.clip(1 - np.abs(2 * time / 20 - 1), 0, 1)
    inputs = dict(time=time, pwm=duty, p_res=np.full_like(time, 2.0e4), p_trb=np.full_like(time, turbine))
    run = simulate(model, vgtjax.Trace(**inputs))
    rng = np.random.default_rng(seed)
    x_d = np.asarray(run.x_d) + noise * (8e-6 * rng.normal(size=len(time)) + 20e-6 * rng.normal())
    p_act = np.asarray(run.p_act) + noise * (60 * rng.normal(size=len(time)) + 50 * rng.normal())
    f_vane = np.asarray(run.f_vane) + noise * 0.05 * rng.normal(size=len(time)) if sensor else None
    return vgtjax.Trace(**inputs, x_d=x_d, p_act=p_act, f_vane=f_vane, name=f"loop_{turbine / 100:.0f}mbar")


@pytest.fixture(scope="module")
def loops():
    model = vgtjax.Actuator(vane_force=TRUE)
    return [bench(model, turbine, seed) for seed, turbine in enumerate((0.0, 1.5e5, 3.0e5))]


def test_both_tables_are_recovered_within_their_errors(loops):
    found = identify_vane_map(EMPTY, loops)
    for name, true in (("closing", CLOSING), ("opening", OPENING)):
        values, errors = found.values[f"vane_force.{name}"], found.std_errors[f"vane_force.{name}"]
        assert np.all(np.abs(values - true) < 4 * errors + 0.05), name  # 0.05 N: speed and inertia are left out
        assert np.all(errors < 0.2), "N; half a newton of friction would drown in more"
    assert found.limitations == ()
    assert {figure.name for figure in found.figures} == {"1500 mbar", "3000 mbar"}


def test_knots_follow_the_pressures_of_the_traces():
    model = vgtjax.Actuator(vane_force=TRUE)
    found = identify_vane_map(EMPTY, [bench(model, 0.0, 5), bench(model, 2.2e5, 6)])
    np.testing.assert_allclose(found.values["vane_force.turbine_pressure"], [2.2e5])
    moved = apply(EMPTY, found)
    assert moved.vane_force.closing.shape == (6,)
    between = CLOSING[:6] + (2.2e5 - 1.5e5) / 1.5e5 * (CLOSING[6:] - CLOSING[:6])
    np.testing.assert_allclose(moved.vane_force.closing, between, atol=0.3)  # four of the errors above


@pytest.mark.parametrize("side_speed", [1e-3, 1e-4])
def test_the_tables_of_a_speed_map_are_filled_too(side_speed):
    """At 1 mm/s, about the loops' own speed, every sample is between the tables."""
    true = vgtjax.Actuator(vane_force=SpeedMap(closing=CLOSING, opening=OPENING, side_speed=side_speed))
    traces = [bench(true, turbine, seed) for seed, turbine in enumerate((0.0, 1.5e5, 3.0e5))]
    empty = vgtjax.Actuator(vane_force=SpeedMap(side_speed=side_speed))
    tests = [test for test, _ in plan(empty, traces)]
    assert identify_vane_map in tests
    moved = apply(empty, identify_vane_map(empty, traces))
    np.testing.assert_allclose(moved.vane_force.closing, CLOSING, atol=0.3)  # as above
    np.testing.assert_allclose(moved.vane_force.opening, OPENING, atol=0.3)
    assert moved.vane_force.side_speed == empty.vane_force.side_speed, "no slow loop tells"


def test_a_force_sensor_needs_no_cold_loop():
    found = identify_vane_map(EMPTY, [bench(vgtjax.Actuator(vane_force=TRUE), 3.0e5, 7, sensor=True)])
    np.testing.assert_allclose(found.values["vane_force.closing"], CLOSING[6:], atol=0.03)
    np.testing.assert_allclose(found.values["vane_force.opening"], OPENING[6:], atol=0.03)


@pytest.mark.parametrize(
    ("pick", "sentence"),
    [
        (lambda loops: loops[:1], "no trace moves slowly under exhaust gas; record loops"),
        (lambda loops: loops[1:], "without exhaust gas, the reference; record a loop at 0 mbar"),
        (lambda loops: [], "no trace moves slowly under exhaust gas"),
    ],
)
def test_what_is_not_possible_is_said(loops, pick, sentence):
    found = identify_vane_map(EMPTY, pick(loops))
    assert found.values == {}
    assert sentence in found.limitations[0]


@pytest.mark.parametrize("empty", [EMPTY, vgtjax.Actuator(vane_force=SpeedMap())], ids=["map", "speed-map"])
def test_half_a_stroke_leaves_the_rest_of_the_table_alone(loops, empty):
    part = [loop.window(0.0, 6.5) for loop in loops]  # closing only, and not to the end
    found = identify_vane_map(empty, part)
    assert np.all(np.isnan(found.std_errors["vane_force.opening"]))
    assert np.all(found.values["vane_force.opening"] == 0.0)
    assert any("while opening" in sentence for sentence in found.limitations)


def test_a_model_without_the_component_says_so(loops):
    assert "choose a model with a HysteresisMap" in identify_vane_map(vgtjax.Actuator(), loops).limitations[0]
    assert "choose a model with a ForcePolynomial" in identify_vane_polynomial(vgtjax.Actuator(), loops).limitations[0]


def test_surface_from_a_force_sensor():
    """Four pressures determine all printed powers; the surface comes back where it was measured."""
    true = vgtjax.Actuator(vane_force=ForcePolynomial())
    traces = [bench(true, turbine, seed, sensor=True) for seed, turbine in enumerate((0.0, 0.4e5, 0.8e5, 1.2e5))]
    found = identify_vane_polynomial(true, traces)
    assert found.limitations == ()
    moved = apply(true, found)
    for angle in (8.0, 16.0, 30.0):
        for turbine in (0.2e5, 1.0e5):
            ratio = true.vane_force.ratio(turbine)
            # Offsets of 20 um are 0.06 deg, and the surface is as steep as 4 N/deg.
            exact = float(true.vane_force.force(angle, ratio))
            assert moved.vane_force.force(angle, ratio) == pytest.approx(exact, abs=0.5)


def test_few_pressures_leave_high_powers_out():
    true = vgtjax.Actuator(vane_force=ForcePolynomial())
    found = identify_vane_polynomial(true, [bench(true, turbine, 3, sensor=True) for turbine in (0.0, 0.8e5)])
    coefficients = found.values["vane_force.coefficients"]
    assert "2 turbine pressures do not determine powers of the ratio above 1" in found.limitations[0]
    assert coefficients[5] == coefficients[9] == 0.0
    assert np.isnan(found.std_errors["vane_force.coefficients"][9])


def test_noise_makes_no_second_pressure():
    """A plateau is one pressure wherever it lies; one that rises from none is as many as it passes."""
    true = vgtjax.Actuator(vane_force=ForcePolynomial())
    random = np.random.default_rng(4)
    hot = bench(true, 1.525e5, 3, sensor=True)
    noisy = hot.replace(p_trb=1.525e5 + random.normal(0, 300.0, len(hot.time)))
    found = identify_vane_polynomial(true, [bench(true, 0.0, 3, sensor=True), noisy])
    assert "2 turbine pressures do not determine powers of the ratio above 1" in found.limitations[0]
    assert _count_pressures(np.linspace(0.0, 1e5, 500)) == 21


def test_the_surface_counts_from_the_atmosphere_of_its_trace():
    """The same pressures before and behind the turbine, of which gauges say others."""
    true = vgtjax.Actuator(vane_force=ForcePolynomial())
    traces = [bench(true, turbine, seed, sensor=True) for seed, turbine in enumerate((0.0, 0.4e5, 0.8e5, 1.2e5))]
    low = 0.8 * 101013.0
    high = [each.replace(p_trb=each.p_trb * 0.8, p_act=each.p_act + low - 101013.0, atmosphere=low) for each in traces]
    found, moved = (identify_vane_polynomial(true, each).values["vane_force.coefficients"] for each in (traces, high))
    # Where the rod rests is read off other pressures, by some micrometres.
    np.testing.assert_allclose(moved, found, rtol=1e-2)
