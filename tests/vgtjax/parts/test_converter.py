"""The converter: printed constants, one-sided spring, orifices."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import Converter
from vgtjax.parts import Plunger

CONVERTER = Converter()


def test_magnetic_force_is_the_printed_quartic():
    duty = 60.0
    expected = 0.021731 + 0.0022634 * duty + 0.0039 * duty**2 - 3.5733e-5 * duty**3 + 9.1355e-8 * duty**4
    assert CONVERTER.magnetic_force.steady_pull(duty, 0.0) == pytest.approx(expected, rel=1e-14)


def acceleration(position):
    zero = jnp.asarray(0.0)
    return CONVERTER.acceleration(Plunger(jnp.asarray(position), zero), zero, zero, zero, zero)


def test_return_spring_acts_only_above_zero():
    """Erratum 6: (2.58) prints it always."""
    above = acceleration(1e-3) - acceleration(0.0)
    below = acceleration(-1e-3) - acceleration(0.0)
    assert above == pytest.approx(-(2000 + 2400) * 1e-3 / 0.01)
    assert below == pytest.approx(2000 * 1e-3 / 0.01)


def test_rest_position_balances_the_forces_on_both_sides():
    for duty in (0.0, 40.0, 100.0):
        args = (jnp.asarray(duty), 101013.0, 2.0e4, 7.0e4)
        position = CONVERTER.rest_position(*args)
        pull = CONVERTER.magnetic_force.steady_pull(args[0], position)
        left = CONVERTER.acceleration(Plunger(position, jnp.asarray(0.0)), pull, *args[1:])
        assert abs(left) < 1e-9  # m/s2, against 1e3 of each force


def test_working_pressure_rests_the_plunger_closed():
    pressure = CONVERTER.working_pressure(jnp.asarray(60.0), 101013.0, 2.0e4)
    assert CONVERTER.rest_position(jnp.asarray(60.0), 101013.0, 2.0e4, pressure) == pytest.approx(0, abs=1e-15)


def test_orifices_are_the_printed_ones_beyond_the_opening():
    assert CONVERTER.orifice_area(jnp.asarray(1e-3)) == pytest.approx(0.342e-6 + 1.68e-7 + 2.299e-8)
    assert CONVERTER.orifice_area(jnp.asarray(-1e-3)) == pytest.approx(0.360e-6)
    assert CONVERTER.orifice_area(jnp.asarray(-9e-3)) == pytest.approx(0.360e-3 * 2.5e-3)


def test_area_has_no_jump_at_the_working_point():
    """The printed 2.299e-8 m2 at zero is a ramp of `opening_width`, whose slope bounds every change."""
    lifts = np.linspace(-5e-6, 5e-6, 2001)
    areas = jax.vmap(CONVERTER.orifice_area)(jnp.asarray(lifts))
    steepest = 2.299e-8 / CONVERTER.opening_width + 0.36e-3
    assert np.max(np.abs(np.diff(areas))) <= steepest * (lifts[1] - lifts[0]) * 1.001
    assert CONVERTER.orifice_area(jnp.asarray(0.0)) == 0.0


def test_the_smoothed_seat_tells_nothing_of_the_plungers_gauge():
    """Stiffer by a factor and lifting less by it, a plunger moves the same air: a null direction of every trace."""
    gauge = 1.7
    stiffer = dataclasses.replace(
        CONVERTER,
        membrane_stiffness=gauge * CONVERTER.membrane_stiffness,
        reservoir_orifice_slope=gauge * CONVERTER.reservoir_orifice_slope,
        reservoir_orifice_saturation=CONVERTER.reservoir_orifice_saturation / gauge,
        atmosphere_orifice=CONVERTER.atmosphere_orifice * jnp.asarray([1.0, gauge, gauge**2]),
    )
    lifts = jnp.asarray([-4e-3, -1e-4, 2e-7, 8e-7, 3e-6, 1e-3])
    # Rounding of products in another order.
    np.testing.assert_allclose(
        jax.vmap(stiffer.orifice_area)(lifts / gauge), jax.vmap(CONVERTER.orifice_area)(lifts), rtol=1e-12
    )


def test_opening_width_is_a_setting_and_no_parameter():
    narrow = dataclasses.replace(CONVERTER, opening_width=1e-7)
    assert jax.tree.leaves(narrow) == jax.tree.leaves(CONVERTER)
