"""Friction against its closed forms, evaluated at a point."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import Coulomb, Dahl, Karnopp, LuGre
from vgtjax.parts import Bristle, Contact, Vanes

FRICTION = LuGre()
NO_LOAD = jnp.asarray(0.0)


def sliding(velocity):
    return Contact(jnp.asarray(velocity), jnp.asarray(0.63), Vanes(jnp.asarray(5e-3), jnp.asarray(0.0)))


def steady_state(velocity, friction=FRICTION):
    return Bristle(jnp.sign(velocity) * friction.stribeck(velocity) / friction.bristle_stiffness)


@pytest.mark.parametrize("exponent", [1, 2])
@pytest.mark.parametrize("velocity", [1e-4, 1e-3, 0.05, -1e-3, -0.05])
def test_sliding_at_constant_speed_is_the_stribeck_curve(velocity, exponent):
    friction = LuGre(stribeck_exponent=exponent)
    force, rate = friction(sliding(velocity), steady_state(velocity, friction), NO_LOAD)
    falling = 0.4 * np.exp(-((abs(velocity) / 1e-3) ** exponent))
    assert force == pytest.approx(np.sign(velocity) * (2.8 + falling) + 206 * velocity, rel=1e-12)
    assert rate.deflection == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("exponent", [0, 3])
def test_no_other_stribeck_exponent(exponent):
    message = rf"stribeck_exponent must be 1 \[3.7\] or 2 \[5.62\], but it is {exponent}; use one of these"
    for friction in (LuGre, vgtjax.PassiveLuGre, vgtjax.AdaptiveLuGre):
        with pytest.raises(vgtjax.InputError, match=message):
            friction(stribeck_exponent=exponent)


def test_force_is_odd_and_a_stretched_bristle_is_a_spring():
    assert FRICTION(sliding(0.0), Bristle(jnp.asarray(2e-5)), NO_LOAD)[0] == pytest.approx(43135.0 * 2e-5)
    forward = FRICTION(sliding(0.01), Bristle(jnp.asarray(3e-5)), NO_LOAD)[0]
    backward = FRICTION(sliding(-0.01), Bristle(jnp.asarray(-3e-5)), NO_LOAD)[0]
    assert forward == pytest.approx(-float(backward), rel=1e-14)


@pytest.mark.parametrize("friction", [FRICTION, LuGre(stribeck_exponent=2), Dahl(), Dahl(shape_exponent=2.0)])
def test_relaxation_is_minus_the_derivative_of_the_state(friction):
    slope = jax.grad(lambda z: friction(sliding(0.02), Bristle(z), NO_LOAD)[1].deflection)(1e-5)
    found = friction.relaxation(sliding(0.02), Bristle(jnp.asarray(1e-5))).deflection
    assert found == pytest.approx(-float(slope), rel=1e-12)


def test_relaxation_of_an_abrupt_bristle_is_a_bound():
    friction = Dahl(shape_exponent=0.5)
    for z in np.linspace(-6e-5, 6e-5, 25):
        slope = jax.grad(lambda z: friction(sliding(0.02), Bristle(z), NO_LOAD)[1].deflection)(z)
        assert friction.relaxation(sliding(0.02), Bristle(jnp.asarray(z))).deflection >= -slope * (1 - 1e-12)


@pytest.mark.parametrize("friction", [FRICTION, vgtjax.PassiveLuGre(), vgtjax.AdaptiveLuGre(), Dahl()])
def test_damping_is_the_slope_of_the_force_while_the_bristles_stick(friction):
    slope = jax.grad(lambda v: friction(sliding(v), Bristle(NO_LOAD), NO_LOAD)[0])(1e-12)
    assert friction.damping(sliding(0.0)) == pytest.approx(float(slope), rel=1e-9)


@pytest.mark.parametrize(
    ("nothing", "damping"),
    [(LuGre(static_force=0.0, coulomb_force=0.0), 429.77 + 206.0), (Dahl(coulomb_force=0.0), 206.0)],
)
def test_no_friction_at_all_is_no_division_by_zero(nothing, damping):
    slope = jax.grad(lambda v: nothing(sliding(v), Bristle(NO_LOAD), NO_LOAD)[0])(0.01)
    assert slope == pytest.approx(damping, rel=1e-12)
    assert nothing(sliding(0.0), Bristle(NO_LOAD), NO_LOAD)[0] == 0.0


@pytest.mark.parametrize("alpha", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_dahls_force_rises_with_distance_as_printed(alpha, direction):
    """[3.2]: `dF/dx = sigma (1 - F sign(v) / F_c)^alpha`."""
    friction = Dahl(shape_exponent=alpha)
    for force in (-2.0, 0.0, 2.0):
        rate = friction(sliding(0.01 * direction), Bristle(jnp.asarray(force / 42150.0)), NO_LOAD)[1].deflection
        printed = (1 - force * direction / 2.8) ** alpha
        assert rate / (0.01 * direction) == pytest.approx(printed, rel=1e-12)


@pytest.mark.parametrize("alpha", [0.5, 2.0])
def test_derivatives_of_dahl_where_its_power_has_a_corner(alpha):
    """Where the bristle slides the print has an infinite slope for an exponent below one, and rounding goes past it;
    the power is held within a thousandth of there."""
    friction = Dahl(shape_exponent=alpha)
    at_end = 2.8 / 42150.0
    for velocity in (0.0, 0.01, -0.01):
        for z in (0.0, at_end, np.nextafter(at_end, 1), -at_end):
            slopes = jax.grad(lambda v, z: friction(sliding(v), Bristle(z), NO_LOAD)[1].deflection, (0, 1))(velocity, z)
            left = 1 - np.sign(velocity) * z / at_end
            assert slopes[0] == pytest.approx(np.sign(left) * abs(left) ** alpha, abs=1e-7)
            steepness = alpha * abs(left) ** (alpha - 1) if abs(left) > 1e-3 else 1e-3 ** (alpha - 1)
            assert slopes[1] == pytest.approx(-abs(velocity) / at_end * steepness, rel=1e-9)


@pytest.mark.parametrize("alpha", [0.0, -1.0, np.inf, np.nan])
def test_dahls_exponent_is_positive(alpha):
    with pytest.raises(vgtjax.InputError, match=f"shape_exponent must be a positive number, but it is {alpha}; use 1"):
        Dahl(shape_exponent=alpha)


@pytest.mark.parametrize("friction", [Coulomb(), Karnopp()])
@pytest.mark.parametrize("velocity", [0.02, -0.02])
def test_sliding_dry_friction_is_exact(friction, velocity):
    """Under any load that keeps the rod sliding for longer than the stick time."""
    for load in (0.0, 20.0 * np.sign(velocity)):
        force = friction(sliding(velocity), None, jnp.asarray(load))[0]
        assert force == pytest.approx(np.sign(velocity) * 2.8 + 206 * velocity, rel=1e-15)


@pytest.mark.parametrize(("friction", "limit"), [(Coulomb(), 2.8), (Karnopp(), 3.2)])
def test_a_stuck_rod_feels_nothing_but_the_force_that_stops_it(friction, limit):
    for load in (0.0, 0.99 * limit, -0.99 * limit):
        assert friction(sliding(0.0), None, jnp.asarray(load))[0] == load
        net = load - friction(sliding(1e-6), None, jnp.asarray(load))[0]
        assert net == pytest.approx(-0.63 * 1e-6 / 1e-3, rel=1e-9)
    assert friction(sliding(0.0), None, jnp.asarray(10.0))[0] == pytest.approx(limit, rel=1e-15)


def test_karnopps_limit_falls_across_its_band_without_a_jump():
    """Erratum 12."""
    friction = Karnopp(velocity_band=2e-3)
    speeds = np.array([0.0, 1e-3, 2e-3, 3e-3, 4e-3, 1.0])
    expected = [3.2, 3.2, 3.2, 3.0, 2.8, 2.8]
    np.testing.assert_allclose([friction.limit(v) for v in speeds], expected, rtol=1e-14)
    np.testing.assert_allclose([friction.limit(-v) for v in speeds], expected, rtol=1e-14)


@pytest.mark.parametrize("friction", [Coulomb(), Karnopp()])
@pytest.mark.parametrize(("velocity", "load"), [(0.0, 1.0), (0.05, 20.0)])
def test_dry_damping_is_the_slope_of_the_force_where_it_sticks_and_where_it_slides(friction, velocity, load):
    slope = jax.grad(lambda v: friction(sliding(v), None, jnp.asarray(load))[0])(velocity)
    assert friction.damping(sliding(velocity)) == pytest.approx(float(slope), rel=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Coulomb(stick_time=0.0), "stick_time must be a positive number of s, but it is 0.0; use e.g. 0.001"),
        (lambda: Karnopp(stick_time=-1.0), "stick_time must be a positive number of s, but it is -1.0; use e.g. 0.001"),
        (
            lambda: Karnopp(velocity_band=np.inf),
            "velocity_band must be a positive number of m/s, but it is inf; use e.g. 0.001",
        ),
    ],
)
def test_widths_are_positive(make, message):
    with pytest.raises(vgtjax.InputError, match=message):
        make()
