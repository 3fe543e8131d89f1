"""The flux between two states of the gas, and its Jacobian [3.45], against closed forms."""

import jax
import numpy as np
import pytest

from vgtjax.turbine import Gas
from vgtjax.turbine._riemann import densities, flux, pack, riemann_flux, states_of

GAS, RADIUS = Gas(), 0.05
DENSITY, PRESSURE, SWIRL = 0.9, 2.3e5, 8.0
SOUND = np.sqrt(1.34 * PRESSURE / DENSITY)
"""m/s, 585."""

ROUNDING = 1e-6
"""W/m2: energies of 1e6 J/m3 times the speed of sound are 6e8 W/m2, and rounding 1e-16 of that."""


def state(velocity, density=DENSITY, pressure=PRESSURE, swirl=SWIRL):
    return pack(*map(np.asarray, (density, velocity, swirl, pressure)))


def carried(velocity, density=DENSITY, pressure=PRESSURE, swirl=SWIRL):
    """Mass, momentum, moment of momentum and energy through a square metre [3.44], by hand."""
    energy = pressure / 0.34 + 0.5 * density * (velocity**2 + (swirl / RADIUS) ** 2)
    mass = density * velocity
    return np.array([mass, mass * velocity + pressure, mass * swirl, (energy + pressure) * velocity])


@jax.jit
def between(left, right):
    return riemann_flux(GAS, left, right, RADIUS)


@jax.jit
def slopes(left, right):
    """Derivatives of the flux and of that between two states with respect to what a cubic metre contains."""

    def by(function, state):
        return jax.jacfwd(lambda contents: function(states_of(GAS, contents, RADIUS)))(densities(GAS, state, RADIUS))

    return (
        by(lambda each: flux(GAS, each, RADIUS), left),
        by(lambda each: riemann_flux(GAS, each, right, RADIUS), left),
        by(lambda each: riemann_flux(GAS, left, each, RADIUS), right),
    )


def by_hand(velocity):
    """(3.45) with `V_u = K / r`, the moment of momentum in the place of the momentum, and its erratum put right."""
    turning = SWIRL / RADIUS
    kinetic = 0.17 * (velocity**2 + turning**2)  # (gamma - 1) / 2
    whole = SOUND**2 / 0.34 + 0.5 * (velocity**2 + turning**2)  # enthalpy
    return np.array(
        [
            [0, 1, 0, 0],
            [kinetic - velocity**2, 1.66 * velocity, -0.34 * turning / RADIUS, 0.34],
            [-velocity * SWIRL, SWIRL, velocity, 0],
            [
                velocity * (kinetic - whole),
                whole - 0.34 * velocity**2,
                -0.34 * velocity * turning / RADIUS,
                1.34 * velocity,
            ],
        ]
    )


@pytest.mark.parametrize("velocity", [120.0, -250.0])
def test_the_jacobian_is_that_of_the_thesis_and_its_eigenvalues_are_as_stated(velocity):
    found, left, right = map(np.asarray, slopes(state(velocity), state(velocity)))
    expected = by_hand(velocity)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * SOUND)
    # A double eigenvalue is known to the root of rounding.
    waves = np.sort(np.linalg.eigvals(found).real)
    np.testing.assert_allclose(waves, [velocity - SOUND, velocity, velocity, velocity + SOUND], atol=1e-6 * SOUND)
    # What a state on the left does and what one on the right does is together what one state does.
    np.testing.assert_allclose(left + right, expected, rtol=1e-9, atol=1e-9 * SOUND)
    # Waves that run to the right come from the left: HLLC takes the outer one and the contact apart.
    assert np.max(np.linalg.eigvals(left).real) == pytest.approx(velocity + SOUND, rel=1e-6)
    assert np.min(np.linalg.eigvals(right).real) == pytest.approx(velocity - SOUND, rel=1e-6)


@pytest.mark.parametrize("velocity", [0.0, 120.0, -250.0, 700.0, -700.0])
def test_between_two_equal_states_the_flux_is_theirs(velocity):
    found = between(state(velocity), state(velocity))
    np.testing.assert_allclose(found, carried(velocity), rtol=1e-12, atol=ROUNDING)


@pytest.mark.parametrize("velocity", [0.0, 150.0, -150.0])
def test_a_contact_stays_one(velocity):
    """Densities and swirls of any difference at one pressure and velocity: gas crosses as the side it comes from has
    it, and none where it is at rest."""
    left, right = {"density": 0.4, "swirl": -3.0}, {"density": 2.0, "swirl": 11.0}
    found = between(state(velocity, **left), state(velocity, **right))
    comes_from = left if velocity >= 0 else right
    np.testing.assert_allclose(found, carried(velocity, **comes_from), rtol=1e-12, atol=ROUNDING)


def test_what_is_faster_than_sound_is_not_told_of_the_other_side():
    fast, behind = {"velocity": 900.0, "density": 0.5}, {"velocity": 850.0, "density": 0.6, "pressure": 2e5}
    np.testing.assert_allclose(between(state(**fast), state(**behind)), carried(**fast), rtol=1e-12)
    back = {**fast, "velocity": -900.0}
    np.testing.assert_allclose(
        between(state(**{**behind, "velocity": -850.0}), state(**back)), carried(**back), rtol=1e-12
    )


def test_a_mirror_turns_it_round():
    left, right = {"velocity": 200.0, "pressure": 3e5}, {"velocity": -40.0, "density": 0.5, "swirl": 2.0}
    found = between(state(**left), state(**right))
    mirrored = between(*[state(**{**each, "velocity": -each["velocity"]}) for each in (right, left)])
    np.testing.assert_allclose(mirrored, found * np.array([-1, 1, -1, -1]), rtol=1e-12)


def test_sound_meets_in_the_middle():
    """Of a small jump of pressure at rest linear acoustics leave its middle and a velocity of `dp / (2 rho a)`."""
    jump = 1e-5 * PRESSURE
    mass, momentum, moment, energy = np.asarray(between(state(0.0), state(0.0, pressure=PRESSURE - jump)))
    velocity = jump / (2 * DENSITY * SOUND)
    # The next order is a share of 1e-5 of each.
    assert momentum == pytest.approx(PRESSURE - jump / 2, rel=1e-9)
    assert mass == pytest.approx(DENSITY * velocity, rel=2e-5)
    assert moment == pytest.approx(DENSITY * velocity * SWIRL, rel=2e-5)
    whole = SOUND**2 / 0.34 + 0.5 * (SWIRL / RADIUS) ** 2
    assert energy == pytest.approx(DENSITY * velocity * whole, rel=2e-5)
