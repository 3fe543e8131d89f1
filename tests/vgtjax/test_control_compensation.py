"""Static balance, differentiators, friction compensation."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import (
    FilteredDifference,
    FrictionCompensation,
    LevantDifferentiator,
    Measurement,
    Scenario,
    Sensors,
    StaticBalance,
    close_loop,
    holding_duty,
)

SURROUNDINGS = Measurement(*(jnp.asarray(value) for value in (0.0, 1.0e5, 2.0e4, 101_013.0)))


LONG = 20.0
"""s"""


def slow_sine(amplitude=0.004):
    """A wave around 5 mm, slow enough for friction to matter more than the lag of the pressure."""
    return control.Sine(amplitude, rate=0.2, offset=0.005)


@jax.jit
def duty_for(pressure, converter):
    return holding_duty(converter, SURROUNDINGS, pressure)


@pytest.mark.parametrize("duty", [20.0, 50.0, 80.0, 99.0])
def test_the_holding_duty_inverts_the_working_pressure(duty):
    converter = vgtjax.Converter()
    pressure = converter.working_pressure(jnp.asarray(duty), SURROUNDINGS.ambient, SURROUNDINGS.reservoir)
    # The quartic is flat near full duty: rounding of 1e5 Pa is worth 1e-10 % there.
    assert float(duty_for(pressure, converter)) == pytest.approx(duty, abs=1e-8)


def test_pressures_out_of_reach_get_the_nearest_duty():
    converter = vgtjax.Converter()
    assert float(duty_for(jnp.asarray(1.5e5), converter)) == 0.0
    assert float(duty_for(jnp.asarray(100.0), converter)) == 100.0


def test_the_holding_duty_has_the_derivative_of_an_implicit_function():
    converter, pressure = vgtjax.Converter(), jnp.asarray(6.0e4)

    def duty(pressure, area):
        return duty_for(pressure, vgtjax.replace_parameters(converter, {"actuator_area": area}))

    area = converter.actuator_area
    by_pressure, by_area = jax.grad(duty, argnums=(0, 1))(pressure, area)
    for found, measured in (
        (by_pressure, (duty(pressure + 1, area) - duty(pressure - 1, area)) / 2),
        (by_area, (duty(pressure, area * 1.00001) - duty(pressure, area * 0.99999)) / (2e-5 * area)),
    ):
        # Bisection ends elsewhere for other arguments, so Newton's last digits differ: 1e-12 % over a step of 1e-3 %.
        assert float(found) == pytest.approx(float(measured), rel=1e-7)


def test_static_balance_holds_a_smooth_plant_at_the_reference(actuator):
    smooth = vgtjax.replace_parameters(actuator, {"friction.static_force": 0.01, "friction.coulomb_force": 0.01})
    run = close_loop(smooth, StaticBalance(), Scenario(slow_sine(amplitude=0.0)), LONG)
    # What friction is left holds the spring back by 0.01 N / 12000 N/m.
    assert float(run.position[-1]) == pytest.approx(0.005, abs=1e-6)
    assert float(run.log["balance_pressure"][-1]) == pytest.approx(float(run.pressure[-1]), abs=5.0)


def slope_error(differentiator, noise=0.0, smallest=0.5):
    """RMS error in m/s of the velocity of a sine of 4 mm and 4 rad/s, after half a second."""
    time = np.arange(3000) * 1e-3
    signal = 0.004 * np.sin(4 * time) + noise * np.random.default_rng(0).standard_normal(3000)
    samples = jnp.asarray(signal)

    def sample(state, value):
        return differentiator.update(state, value, 1e-3)

    _, velocity = jax.jit(lambda: jax.lax.scan(sample, differentiator.initial_state(samples[0]), samples))()
    return float(np.sqrt(np.mean((velocity - 0.016 * np.cos(4 * time))[time > smallest] ** 2)))


def test_a_filtered_difference_lags_by_its_filter():
    # The slope of the velocity, 0.064 m/s2, times the filter's 5 ms and half a period, over root two.
    assert slope_error(FilteredDifference(0.005)) == pytest.approx(0.064 * 5.5e-3 / 2**0.5, rel=0.02)


def test_levants_differentiator_is_exact_up_to_the_sampling_and_bears_noise():
    sharp, smooth = LevantDifferentiator(0.5), LevantDifferentiator(0.5, width=2e-5)
    # Explicit Euler chatters by about L times the period, 5e-4 m/s; nothing lags by a filter.
    assert slope_error(sharp) < 5e-4
    assert slope_error(smooth) < 5e-4
    # With 8 um of noise: below the plain filter's error, and the smooth relative below both.
    plain, noisy, soft = (slope_error(d, 8e-6) for d in (FilteredDifference(0.005), sharp, smooth))
    assert soft < noisy < plain


def test_the_smooth_relative_becomes_levants_law_as_its_width_falls():
    state = FilteredDifference().initial_state(jnp.asarray(1e-3))
    sharp = LevantDifferentiator(2.0, width=1e-15)
    after, slope = sharp.update(state, jnp.asarray(1.1e-3), 1e-3)
    # z1 gains 1.1 L T, z0 gains 1.5 sqrt(L |s|) T (Levant, 1998).
    assert float(slope) == pytest.approx(1.1 * 2.0 * 1e-3)
    assert float(after.value) == pytest.approx(1e-3 + 1.5 * np.sqrt(2.0 * 1e-4) * 1e-3)


def test_friction_compensation_tracks_what_static_balance_does_not(actuator):
    """Measured: 0.39 mm without, 0.05 mm with, 0.08 mm under the bench's noise."""

    def peak(controller, sensors):
        run = close_loop(actuator, controller, Scenario(slow_sine(), sensors=sensors), LONG)
        return 1e3 * float(control.tracking_peak(run, 4.0))

    plain = peak(StaticBalance(), Sensors.ideal())
    assert peak(FrictionCompensation(), Sensors.ideal()) < 0.25 * plain
    assert peak(FrictionCompensation(), Sensors.bench()) < 0.35 * plain


def test_compensation_that_is_not_strictly_positive_real_is_refused():
    bound = 43135.0 * 0.63 / 429.77
    assert bound == pytest.approx(63.2, abs=0.05)  # N s/m
    with pytest.raises(vgtjax.InputError, match=r"derivative_gain must exceed 63\.23 N s/m .* but it is 63; raise it"):
        FrictionCompensation(derivative_gain=63.0)
    assert float(FrictionCompensation(derivative_gain=64.0).damping_margin()) == pytest.approx(64 - bound)
    damped = dataclasses.replace(vgtjax.Actuator().diaphragm, damping=10.0)
    assert float(FrictionCompensation(derivative_gain=54.0, diaphragm=damped).damping_margin()) > 0
    with pytest.raises(vgtjax.InputError, match="proportional_gain must exceed minus the spring's"):
        FrictionCompensation(proportional_gain=-12_000.0)


@pytest.mark.parametrize(("gain", "positive"), [(64.0, True), (62.0, False)])
def test_the_bound_is_where_the_transfer_function_leaves_the_right_half_plane(gain, positive):
    """Real part of [5.9] over frequency, with `H = k_p + k_d s`."""
    s = 1j * np.logspace(-2, 5, 2000)
    transfer = (429.77 * s + 43135.0) / (0.63 * s**2 + gain * s + 12_000.0 + 12_000.0)
    assert bool(np.all(transfer.real > 0)) is positive
