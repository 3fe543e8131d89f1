"""What identifications are made of: noise that is removed, kernels, bristles, and a regression with its errors."""

import gc
import weakref

import numpy as np
import pytest
from axis import axis
from support import rms

import vgtjax
from vgtjax.identification.mechanical._bristles import bristle_force
from vgtjax.identification.mechanical._clean_signals import clean_signals
from vgtjax.identification.mechanical._motion import read_motion
from vgtjax.identification.mechanical._weak_form import TraceEquations, filter_motion, regress_traces
from vgtjax.traces import remove_noise


def test_noise_goes_and_corners_stay():
    time = np.arange(0, 2, 1e-3)
    pressure = 1e5 - 4e4 * np.where(time > 0.5, 1 - np.exp(-(time - 0.5) / 0.3), 0.0)
    noise = np.random.default_rng(6).normal(0, 60, len(time))
    left = remove_noise(pressure + noise, 60.0) - pressure
    assert rms(left) < 15
    assert np.max(np.abs(left[450:550])) < 200  # at the corner, where a window of 20 ms is off by 330


def test_signals_are_cleaned_once_for_all_tests_and_go_with_their_trace():
    time = np.arange(0, 2, 1e-3)
    pressure = 1e5 - 4e4 * np.where(time > 0.5, 1 - np.exp(-(time - 0.5) / 0.3), 0.0)
    random = np.random.default_rng(6)
    x_d, p_act = random.normal(0, 8e-6, len(time)), pressure + random.normal(0, 60, len(time))
    trace = vgtjax.Trace(time, x_d=x_d, p_act=p_act)
    signals = clean_signals(trace)
    assert clean_signals(trace) is signals
    first, second = signals.pressure_again(0), signals.pressure_again(1)
    assert signals.pressure_again(0) is first
    np.testing.assert_array_equal(clean_signals(vgtjax.Trace(time, x_d=x_d, p_act=p_act)).pressure_again(0), first)
    for again in (first, second):  # 8 to 14 Pa of 60 are left of each of two noises
        assert 4 < rms(again - signals.pressure) < 20
        assert rms(again - pressure) < 25
    assert rms(first - second) > 4
    alive = weakref.ref(signals)
    del trace, signals
    gc.collect()
    assert alive() is None


def test_what_has_no_noise_is_left_alone():
    samples = np.sin(np.arange(100.0))
    np.testing.assert_array_equal(remove_noise(samples, 0.0), samples)
    np.testing.assert_array_equal(remove_noise(samples[:6], 1.0), samples[:6])


def test_kernels_are_exact_on_parabolas_far_from_zero():
    time = np.arange(0, 1, 1e-3)
    trace = vgtjax.Trace(time=time, f_drive=3 * time, x_d=0.7 + 0.2 * time - 1.5 * time**2)
    seen = filter_motion(read_motion(axis(vgtjax.Coulomb()), trace), 0.03)
    np.testing.assert_allclose(seen.velocity[seen.valid], (0.2 - 3 * time)[seen.valid], atol=1e-9)
    np.testing.assert_allclose(seen.acceleration[seen.valid], -3.0, rtol=1e-6)
    np.testing.assert_allclose(seen.force[seen.valid], 3 * time[seen.valid], atol=1e-9)


def test_bristles_turn_as_dahl_says():
    """After a turn, `F = F_c (1 - 2 exp(-sigma dx / F_c))` [section 3.3.2.2]."""
    deflection = 7e-5
    out, back = np.linspace(0, 2e-3, 300), np.linspace(2e-3, 1e-3, 300)
    force = bristle_force(np.concatenate([out, back]), np.ones(600), deflection)
    np.testing.assert_allclose(force[:300], 1 - np.exp(-out / deflection), atol=1e-12)
    np.testing.assert_allclose(force[300:], -(1 - 2 * np.exp(-(2e-3 - back) / deflection)), atol=1e-9)


def test_errors_of_a_regression_know_of_correlated_noise_and_of_constants():
    """Monte Carlo: noise that lasts 20 rows, and an unknown constant of each trace."""
    random, time = np.random.default_rng(7), np.arange(0, 20, 1e-2)
    drift, scores = np.ones(20) / 20, []
    for _ in range(60):
        blocks = []
        for _ in range(3):
            matrix = np.stack([np.ones_like(time), np.sin(time)], axis=1)
            noise = np.convolve(random.normal(size=len(time) + 19), drift, "valid") + random.normal(0, 0.3)
            blocks.append(TraceEquations(matrix, matrix @ [2.0, 5.0] + noise, time, 20, 0.3))
        solution = regress_traces(blocks)
        scores.append((solution.values - [2.0, 5.0]) / solution.std_errors)
    assert np.all(np.sqrt(np.mean(np.square(scores), axis=0)) < 1.5)
    assert np.all(np.sqrt(np.mean(np.square(scores), axis=0)) > 0.5)


def test_a_regression_says_which_unknowns_it_can_not_tell_apart():
    time = np.arange(0, 5, 1e-2)
    matrix = np.stack([np.ones_like(time), np.sin(time), np.full_like(time, 2.0)], axis=1)
    solution = regress_traces(
        [TraceEquations(matrix, np.sin(time) + np.random.default_rng(8).normal(0, 0.1, len(time)), time, 1, 0.0)]
    )
    assert np.isnan(solution.values[[0, 2]]).all()
    assert solution.values[1] == pytest.approx(1.0, abs=0.05)
