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


def slope_error(differentiator, noise=0.0, known=0.0):
    """RMS error in m/s of the velocity of a sine of 4 mm and 4 rad/s after half a second, in m of its value.

    `known` is the share of its derivative that the differentiator is given.
    """
    time = np.arange(3000) * 1e-3
    wave = 0.004 * np.sin(4 * time)
    samples = jnp.asarray(wave + noise * np.random.default_rng(0).standard_normal(3000))

    def sample(state, inputs):
        state, slope = differentiator.update(state, inputs[0], 1e-3, inputs[1])
        return state, (slope, differentiator.value(state, 1e-3, inputs[1]))

    inputs = samples, jnp.asarray(0.016 * known * np.cos(4 * time))
    _, found = jax.jit(lambda: jax.lax.scan(sample, differentiator.initial_state(samples[0]), inputs))()
    settled = time > 0.5
    errors = (np.asarray(found[0]) - 0.016 * np.cos(4 * time), np.asarray(found[1]) - wave)
    return tuple(float(np.sqrt(np.mean(error[settled] ** 2))) for error in errors)


def test_a_filtered_difference_lags_by_its_filter():
    # The slope of the velocity, 0.064 m/s2, times the filter's 5 ms and half a period, over root two.
    assert slope_error(FilteredDifference(0.005))[0] == pytest.approx(0.064 * 5.5e-3 / 2**0.5, rel=0.02)


def test_levants_differentiator_is_exact_up_to_the_sampling_and_bears_noise():
    sharp, smooth = LevantDifferentiator(0.5), LevantDifferentiator(0.5, width=2e-5)
    # Explicit Euler chatters by about L times the period, 5e-4 m/s; nothing lags by a filter.
    assert slope_error(sharp)[0] < 5e-4
    assert slope_error(smooth)[0] < 5e-4
    # With 8 um of noise: below the plain filter's error, and the smooth relative below both.
    plain, noisy, soft = (slope_error(d, 8e-6)[0] for d in (FilteredDifference(0.005), sharp, smooth))
    assert soft < noisy < plain


@pytest.mark.parametrize("slow", [LevantDifferentiator(0.3, width=2e-3), FilteredDifference(0.1)])
def test_a_slow_differentiator_does_not_lag_behind_a_velocity_that_it_expects(slow):
    # Two steps of 0.064 m/s2: of Euler's method, and of the velocity that a difference of samples is half a step late.
    assert slope_error(slow, known=1.0)[0] < 2 * 0.064 * 1e-3
    assert slope_error(slow)[0] > 10 * slope_error(slow, known=1.0)[0]
    assert slope_error(slow)[0] > 1.5 * slope_error(slow, known=0.5)[0]


def test_what_is_expected_lets_levants_differentiator_be_slow_enough_for_the_noise():
    fast, slow = LevantDifferentiator(0.5, width=2e-5), LevantDifferentiator(0.3, width=2e-3)
    slope, value = slope_error(slow, 8e-6, known=1.0)
    # The noise falls with the filter's frequency, 13 for 166 rad/s, to the power of 3/2; Euler's step is left.
    assert slope < 0.05 * slope_error(fast, 8e-6)[0] + 0.064 * 1e-3
    # Of the noise about a tenth, and what the slope misses over 1.5 sqrt(L / w) = 18 1/s.
    assert value < 0.15 * 8e-6 + 0.064 * 1e-3 / 18


def test_the_smooth_relative_becomes_levants_law_as_its_width_falls():
    state = FilteredDifference().initial_state(jnp.asarray(1e-3))
    sharp = LevantDifferentiator(2.0, width=1e-15)
    after, slope = sharp.update(state, jnp.asarray(1.1e-3), 1e-3)
    # z1 gains 1.1 L T, z0 gains 1.5 sqrt(L |s|) T (Levant, 1998).
    assert float(slope) == pytest.approx(1.1 * 2.0 * 1e-3)
    assert float(after.value) == pytest.approx(1e-3 + 1.5 * np.sqrt(2.0 * 1e-4) * 1e-3)


def test_friction_compensation_tracks_what_static_balance_does_not(actuator):
    """Measured: 0.39 mm without, 0.019 mm with, 0.020 mm under the noise of sensors."""

    def peak(controller, sensors):
        run = close_loop(actuator, controller, Scenario(slow_sine(), sensors=sensors), LONG)
        return 1e3 * float(control.tracking_peak(run, 4.0))

    plain = peak(StaticBalance(), Sensors.ideal())
    # Far below what the knocker leaves, 0.067 mm [section 5.3.3].
    assert peak(FrictionCompensation(), Sensors.ideal()) < 0.1 * plain
    assert peak(FrictionCompensation(), Sensors.bench()) < 0.1 * plain


def test_friction_compensation_knows_the_gas_where_it_is_given(actuator):
    """Measured: peaks of 0.021 mm with the vane force that the plant has, 0.065 mm without."""
    gas = vgtjax.HysteresisMap(closing=np.linspace(5.0, 2.4, 12), opening=np.linspace(-3.6, -1.8, 12))
    plant = dataclasses.replace(actuator, vane_force=gas)
    scenario = Scenario(slow_sine(), control.Constant(3e5), sensors=Sensors.bench())

    @jax.jit
    @jax.vmap
    def error(known):
        run = close_loop(plant, FrictionCompensation(vane_force=known), scenario, LONG, throw=False)
        return control.tracking_rms(run, 4.0)

    # Without its values a map is zero.
    known, blind = error(jax.tree.map(lambda *leaves: jnp.stack(leaves), gas, vgtjax.HysteresisMap()))
    assert float(known) < 0.3 * float(blind)


def test_compensation_that_is_not_strictly_positive_real_is_refused():
    bound = 43135.0 * 0.63 / 429.77
    assert bound == pytest.approx(63.2, abs=0.05)  # N s/m
    with pytest.raises(vgtjax.InputError, match=r"derivative_gain must exceed 63\.23 N s/m .* is 63\.0; raise it"):
        FrictionCompensation(derivative_gain=63.0)

    def margin(**settings):
        return float(FrictionCompensation(**settings).conditions()["derivative_gain above its bound [5.9]"].margin)

    assert margin(derivative_gain=64.0) == pytest.approx(64 / bound - 1)
    damped = dataclasses.replace(vgtjax.Actuator().diaphragm, damping=10.0)
    assert margin(derivative_gain=54.0, diaphragm=damped) > 0
    with pytest.raises(vgtjax.InputError, match="proportional_gain must exceed minus the spring's"):
        FrictionCompensation(proportional_gain=-12_000.0)


@pytest.mark.parametrize(("gain", "positive"), [(64.0, True), (62.0, False)])
def test_the_bound_is_where_the_transfer_function_leaves_the_right_half_plane(gain, positive):
    """Real part of [5.9] over frequency, with `H = k_p + k_d s`."""
    s = 1j * np.logspace(-2, 5, 2000)
    transfer = (429.77 * s + 43135.0) / (0.63 * s**2 + gain * s + 12_000.0 + 12_000.0)
    assert bool(np.all(transfer.real > 0)) is positive
