"""Coil: inductance, force and power; agreement with the identified force in steady state; a plunger without a stop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import Actuator, Coil, Converter, replace_parameters, simulate
from vgtjax.parts import StaticForce

COIL = Coil()
MODEL = Actuator(converter=Converter(magnetic_force=COIL))
QUARTIC = Converter().magnetic_force
DUTIES = np.linspace(0.0, 100.0, 1001)
POSITIONS = np.array([-2.4e-3, -1e-3, 0.0, 1e-3, 4e-3])


def steady(coil, position=0.0):
    return np.asarray(jax.vmap(lambda duty: coil.steady_pull(duty, jnp.asarray(position)))(DUTIES))


@pytest.fixture(scope="module")
def quartic():
    assert isinstance(QUARTIC, StaticForce)
    return np.asarray(jax.vmap(lambda duty: QUARTIC.steady_pull(duty, jnp.asarray(0.0)))(DUTIES))


@pytest.mark.parametrize("position", POSITIONS)
def test_inductance_and_its_slope(position):
    """[2.2-2.4] with `x_t + x_p` (erratum)."""
    inductance, slope = COIL.inductance(jnp.asarray(position))
    path = 0.05 + 1000 * (0.025 + position)
    assert inductance == pytest.approx(7500**2 * 2e-4 * 1000 * 4e-7 * np.pi / path)
    assert slope == pytest.approx(jax.grad(lambda x: COIL.inductance(x)[0])(position))
    assert slope < 0, "a plunger that comes down closes the gap"


@pytest.mark.parametrize("position", POSITIONS)
def test_force_is_that_of_the_flux_and_pulls_down(position):
    """[2.5, 2.6]: `B^2 A / (2 mu_0)` with `B = L i / (N A)`."""
    current = jnp.asarray(0.7)
    state = COIL.initial_state(jnp.asarray(50.0))
    state = jax.tree.map(lambda leaf: jnp.full_like(leaf, current), state)
    pull, _ = COIL(jnp.asarray(0.0), jnp.asarray(position), jnp.asarray(0.0), state)
    flux = COIL.inductance(jnp.asarray(position))[0] * current / (7500 * 2e-4)
    assert pull == pytest.approx(float(flux**2 * 2e-4 / (2 * 4e-7 * np.pi)))
    resting = vgtjax.parts.Plunger(jnp.asarray(position), jnp.asarray(0.0))
    pulled, free = (
        MODEL.converter.acceleration(resting, force, 101013.0, 2.0e4, 101013.0) for force in (pull, jnp.asarray(0.0))
    )
    assert pulled < free


def test_steady_force_is_the_quartic(quartic):
    """The default map is fitted to [B.1]; the largest residual is at a duty of 6 %."""
    residual = steady(COIL) - quartic
    assert 0.02 < abs(residual).max() < 0.03


def test_duty_as_share_of_the_voltage_misses_the_quartic(quartic):
    """The force goes with the square of the duty, and even its best multiple misses by 3.4 N."""
    plain = steady(Coil(duty_map=[1.0, 0.0, 0.0]))
    np.testing.assert_allclose(plain, plain[-1] * (DUTIES / 100) ** 2, rtol=1e-9, atol=1e-12)
    best = plain * (plain @ quartic) / (plain @ plain)
    assert abs(best - quartic).max() == pytest.approx(3.4, abs=0.05)


def test_the_membrane_is_stiffer_than_the_magnet():
    """`2 F / x` at full duty, from the closed plunger down; where inductance is straight there is none."""

    def stiffness(position):
        return -jax.grad(lambda x: COIL.steady_pull(jnp.asarray(100.0), x))(position)

    membrane = float(MODEL.converter.membrane_stiffness)
    assert stiffness(0.0) == pytest.approx(1010, abs=5)
    assert stiffness(-2.4999e-3) == pytest.approx(1390, abs=5)
    assert stiffness(-3e-3) == 0
    assert all(stiffness(x) < 0.75 * membrane for x in np.linspace(-2.5e-3, 5e-3, 50))


def test_inductance_stays_positive_however_far_down_the_plunger_is():
    """It goes on along its tangent; without that it is infinite at -25 mm."""
    below = np.linspace(-0.1, -2.5e-3, 200)
    inductance, slope = jax.vmap(COIL.inductance)(below)
    assert np.all(np.diff(inductance) < 0)
    assert np.all(np.asarray(inductance) > 0)
    np.testing.assert_allclose(slope, slope[-1], rtol=1e-12)
    edge = [COIL.inductance(jnp.asarray(-2.5e-3 + shift)) for shift in (-1e-12, 1e-12)]
    np.testing.assert_allclose(edge[0], edge[1], rtol=1e-8)


def test_a_core_that_swallows_the_plunger_is_a_failed_simulation():
    swallowed = Coil(gap=1e-3)
    assert np.all(np.isnan(swallowed.inductance(jnp.asarray(-2e-3))))
    model = Actuator(converter=Converter(magnetic_force=swallowed))
    run = simulate(model, duty_trace((0, 0.05), (100, 0.2), p_res=2.0e4), throw=False)
    assert run.result == vgtjax.RESULTS.diverged


def test_current_follows_with_the_time_constant_of_the_coil():
    """`L / R` is 51 ms at rest; the plunger is too heavy to move."""
    inductance, _ = COIL.inductance(jnp.asarray(0.0))
    constant = float(inductance) / 11.0
    assert constant == pytest.approx(0.051, abs=0.001)
    heavy = replace_parameters(MODEL, {"converter.plunger_mass": 1e6})
    run = simulate(heavy, duty_trace((0, 0.05), (60, 0.3), p_res=2.0e4))
    final = float(COIL.voltage(jnp.asarray(60.0))) / 11.0
    elapsed = np.maximum(run.time - 0.05, 0)
    # It stands 50 um above zero, 0.2 % of the gap.
    np.testing.assert_allclose(run.i, final * (1 - np.exp(-elapsed / constant)), rtol=0, atol=2e-3 * final)


def test_power_of_the_coil_is_heat_field_and_work():
    """`U i = R i^2 + d/dt(L i^2 / 2) - F v`, integrated; the plunger that comes down takes work from the coil."""
    trace = duty_trace((0, 0.02), (100, 0.15), (30, 0.15), (70, 0.1), interval=1e-4, p_res=2.0e4)
    run = simulate(MODEL, trace)
    inductance, slope = (np.asarray(part) for part in jax.vmap(COIL.inductance)(run.x_p))
    current, velocity = np.asarray(run.i), np.asarray(run.v_p)
    voltage = np.asarray(jax.vmap(COIL.voltage)(trace.pwm))
    force = -0.5 * current**2 * slope

    def integral(power, held=None):
        """By the trapezoidal rule; the voltage is held over each interval."""
        ends = power[1:] if held is None else held[:-1] * current[1:]
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[:-1] + ends) * 1e-4)])

    supplied = integral(voltage * current, voltage)
    field = 0.5 * inductance * current**2
    work = integral(-force * velocity)
    balance = supplied - integral(11.0 * current**2) - (field - field[0]) - work
    assert rms(balance) < 1e-5 * np.ptp(supplied)
    assert rms(balance + 2 * work) > 1e-3 * np.ptp(supplied), "the work would not matter"
    assert work[200:1000].max() > 0


def test_a_held_duty_starts_at_rest():
    trace = duty_trace((60, 0.3), p_res=2.0e4)
    run = simulate(MODEL, trace)
    np.testing.assert_allclose(run.i, run.i[0], rtol=1e-6)
    assert abs(run.v_p).max() < 1e-4
    assert abs(float(run.p_act[-1] - run.p_act[0])) < 300  # breathing through the leak, as with the quartic


@pytest.mark.parametrize("duty", [0.0, 40.0, 100.0])
@pytest.mark.parametrize("pressure", [3e4, 6e4, 1.01e5])
def test_rest_position_is_a_balance(duty, pressure):
    """The pull depends on the position: iterated, by a ratio of at most 0.7."""
    at = MODEL.converter.rest_position(jnp.asarray(duty), 101013.0, 2.0e4, jnp.asarray(pressure))
    still = vgtjax.parts.Plunger(at, jnp.zeros_like(at))
    pull = COIL.steady_pull(jnp.asarray(duty), at)
    force = MODEL.converter.acceleration(still, pull, 101013.0, 2.0e4, jnp.asarray(pressure)) * 0.01
    assert abs(force) < 1e-3


def test_full_duty_ends_where_the_quartic_does_but_later():
    """A plunger without a stop goes 6 mm down at first; the residual of 0.02 N is 115 Pa."""
    trace = duty_trace((0, 0.05), (60, 2.0), p_res=2.0e4)
    coil, static = simulate(MODEL, trace), simulate(Actuator(), trace)
    assert abs(float(coil.p_act[-1] - static.p_act[-1])) < 200
    drop = 0.632 * float(101013 - static.p_act[-1])
    late = [np.argmax(101013 - np.asarray(run.p_act) > drop) for run in (static, coil)]
    assert 15 < late[1] - late[0] < 100  # ms
    assert simulate(MODEL, duty_trace((0, 0.05), (100, 0.3), p_res=2.0e4)).x_p.min() < -2.6e-3


def test_more_inductance_is_slower():
    """Turns and supply voltage up together: the same steady force, more time."""

    def drop(turns, supply):
        changed = {"converter.magnetic_force.turns": turns, "converter.magnetic_force.supply_voltage": supply}
        run = simulate(replace_parameters(MODEL, changed), duty_trace((0, 0.05), (80, 0.1), p_res=2.0e4))
        return 101013 - float(run.p_act[-1])

    assert drop(10_000, 9.0) < drop(7500, 12.0) < drop(5000, 18.0)
