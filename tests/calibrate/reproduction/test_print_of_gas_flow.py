"""Derivations that section 3.5 prints, term by term on smooth fields that obey no law: what must hold for any fields
holds to rounding, and what the print has in its place does not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax.turbine import Gas

PLACE = jnp.array([0.3, 0.7])
"""Time and distance at which all terms are taken."""


def density(t, m):
    return 1.2 + 0.3 * jnp.sin(m + 2 * t)


def along(t, m):
    return 0.7 + 0.2 * jnp.cos(3 * m - t)


def around(t, m):
    return 1.1 - 0.4 * jnp.sin(2 * m + t)


def pressure(t, m):
    return 2.0 + 0.5 * jnp.cos(m - 3 * t)


def area(t, m):
    return 1.0 + 0.4 * m**2


def radius(t, m):
    return 2.0 - 0.6 * m


def kinetic(t, m):
    return 0.5 * (along(t, m) ** 2 + around(t, m) ** 2)


def energy(t, m):
    return pressure(t, m) / (0.34 * density(t, m)) + kinetic(t, m)


def of(*factors):
    """The product of fields."""
    return lambda t, m: jnp.prod(jnp.stack([factor(t, m) for factor in factors]))


def at(*factors):
    return of(*factors)(*PLACE)


def rate(*factors):
    """Derivative of a product of fields with respect to time."""
    return jax.grad(of(*factors), 0)(*PLACE)


def slope(*factors):
    """With respect to distance."""
    return jax.grad(of(*factors), 1)(*PLACE)


def mass():
    """What (3.25) leaves."""
    return rate(density, area) + slope(density, along, area)


def newton():
    """What is left of a gas's density times its acceleration along `m`, as (3.22) has it, less minus the gradient of
    pressure."""
    swirl = slope(radius, around) * at(around) / at(radius)
    acceleration = rate(along) - swirl + slope(kinetic)
    return at(density) * acceleration + slope(pressure)


def momentum():
    """What (3.29) leaves."""
    given = at(density, area, around, around) / at(radius) * slope(radius) + at(pressure) * slope(area)
    return rate(density, area, along) + slope(density, area, along, along) + slope(area, pressure) - given


def test_momentum_is_newtons_law_and_the_balance_of_mass():
    """(3.26) to (3.28): of the pressure's force `-S grad p` is left, as the walls carry `p grad S`; a minus before
    `grad p`, and no density in the rate of the velocity."""
    np.testing.assert_allclose(momentum(), at(area) * newton() + at(along) * mass(), rtol=1e-12)
    as_printed = newton() - slope(pressure) + slope(area, pressure) / at(area)  # (3.27)
    assert abs(momentum() - at(area) * as_printed - at(along) * mass()) > 0.1


def test_the_rate_of_a_product_has_both_parts():
    """(3.28): `V d(S rho)/dt` is added to `S rho dV/dt`, not taken off."""
    both = at(area, density) * rate(along)
    np.testing.assert_allclose(rate(area, density, along), both + at(along) * rate(area, density), rtol=1e-12)
    assert abs(rate(area, density, along) - (both - at(along) * rate(area, density))) > 0.1


def test_the_power_of_pressure_is_counted_once():
    """(3.31) to (3.34): `div(p V)` has `V . grad p` in it. As (3.33) is printed it counts that twice, and leaves out
    that the area changes."""
    right = rate(area, density, energy) + slope(area, density, along, energy) + slope(area, along, pressure)
    first = rate(area, density, energy) + at(area, density, along) * slope(energy)
    first += at(energy) * slope(area, density, along)
    both = at(along, area) * slope(pressure) + at(pressure) * slope(area, along)
    np.testing.assert_allclose(right, first + both, rtol=1e-12)
    as_printed = first + at(along, area) * slope(pressure) + at(area) * slope(pressure, along)
    over = at(along, area) * slope(pressure) - at(pressure, along) * slope(area)
    np.testing.assert_allclose(as_printed - right, over, rtol=1e-12)
    assert abs(over) > 0.1


def test_what_follows_from_contents_is_pressure_times_area():
    """(3.43): the vector of (3.37) has the area in all its rows."""
    contents = [at(area, density), at(area, density, along), at(area, density, around), at(area, density, energy)]
    found = 0.34 * (contents[3] - 0.5 * (contents[1] ** 2 + contents[2] ** 2) / contents[0])
    np.testing.assert_allclose(found, at(pressure, area), rtol=1e-12)
    assert abs(found - at(pressure)) > 0.1


def test_a_gas_constant_is_that_of_the_gas():
    """(3.40): with the universal one, which the print names, sound in air at 300 K would not run at 347 m/s."""
    assert float(Gas(1.4, 287.0).sound_speed(300.0)) == pytest.approx(347.2, abs=0.1)
    assert float(Gas(1.4, 8.314).sound_speed(300.0)) < 60


def test_blades_take_the_whole_change_of_moment_of_momentum():
    """(3.50): `m_(i+1) - m_(i-1)` spans two cells, over which the force of one is spread; the row gives half."""
    step, flow, wide, swirl = 0.1, 0.3, 0.8, np.array([1.0, 1.4, 1.9, 2.1])
    for cells, share in ((1, 1.0), (2, 0.5)):  # (3.49), (3.50)
        moments = np.diff(swirl) * flow / (wide * cells * step)  # r F_bu
        assert np.sum(moments * wide * step) == pytest.approx(share * flow * (swirl[-1] - swirl[0]))


def test_an_implicit_step_goes_down_the_residual():
    """(3.70) has another sign than (3.69), from which it is made: with a linear flux `A U` and source `B U` one step
    must solve (3.68). What multiplies the change is the derivative of `A dU`, not that of `A` times `dU`."""
    matrices = np.random.default_rng(0)
    cells, variables, duration = 5, 4, 0.1
    flux, source = matrices.normal(size=(2, variables, variables))
    differ = (np.eye(cells) - np.eye(cells, k=-1)) / 0.2  # upwind; nothing comes in
    out, gained = np.kron(differ, flux), np.kron(np.eye(cells), source)
    state = matrices.normal(size=cells * variables)
    residual = out @ state - gained @ state
    system = np.eye(state.size) + duration * (out - gained)

    def left(change):
        """Of (3.68)."""
        return change / duration + (out - gained) @ (state + change)

    right, printed = (np.linalg.solve(system, sign * duration * residual) for sign in (-1, 1))
    np.testing.assert_allclose(left(right), 0, atol=1e-12)
    assert np.max(np.abs(left(printed))) > 0.1
