"""LuGre friction against its closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import LuGre
from vgtjax.friction import Bristle, Contact
from vgtjax.vanes import Vanes

FRICTION = LuGre()


def sliding(velocity):
    return Contact(jnp.asarray(velocity), jnp.asarray(0.63), Vanes(jnp.asarray(5e-3), jnp.asarray(0.0)))


def steady_state(velocity):
    return Bristle(jnp.sign(velocity) * FRICTION.stribeck(velocity) / FRICTION.bristle_stiffness)


@pytest.mark.parametrize("velocity", [1e-4, 1e-3, 0.05, -1e-3, -0.05])
def test_sliding_at_constant_speed_is_the_stribeck_curve(velocity):
    force, rate = FRICTION(sliding(velocity), steady_state(velocity), jnp.asarray(0.0))
    falling = 0.4 * np.exp(-abs(velocity) / 1e-3)
    assert force == pytest.approx(np.sign(velocity) * (2.8 + falling) + 206 * velocity, rel=1e-12)
    assert rate.deflection == pytest.approx(0.0, abs=1e-15)


def test_force_is_odd_and_a_stretched_bristle_is_a_spring():
    still = jnp.asarray(0.0)
    assert FRICTION(sliding(0.0), Bristle(jnp.asarray(2e-5)), still)[0] == pytest.approx(43135.0 * 2e-5)
    forward = FRICTION(sliding(0.01), Bristle(jnp.asarray(3e-5)), still)[0]
    backward = FRICTION(sliding(-0.01), Bristle(jnp.asarray(-3e-5)), still)[0]
    assert forward == pytest.approx(-float(backward), rel=1e-14)


def test_relaxation_is_minus_the_derivative_of_the_state():
    velocity = jnp.asarray(0.02)
    slope = jax.grad(lambda z: FRICTION(sliding(velocity), Bristle(z), velocity)[1].deflection)(1e-5)
    assert FRICTION.relaxation(sliding(velocity), None).deflection == pytest.approx(-float(slope), rel=1e-12)


def test_damping_is_the_slope_of_the_force_while_the_bristles_stick():
    slope = jax.grad(lambda v: FRICTION(sliding(v), Bristle(jnp.asarray(0.0)), v)[0])(1e-12)
    assert FRICTION.damping(sliding(0.0)) == pytest.approx(float(slope), rel=1e-9)


def test_no_friction_at_all_is_no_division_by_zero():
    nothing = LuGre(static_force=0.0, coulomb_force=0.0)
    still = jnp.asarray(0.0)
    slopes = jax.grad(lambda v: nothing(sliding(v), Bristle(jnp.asarray(0.0)), v)[0])(0.01)
    assert np.isfinite(slopes)
    assert nothing(sliding(0.0), Bristle(still), still)[0] == 0.0
