"""LuGre friction at a given velocity against its differential equation, and its derivatives [4.6-4.8]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vgtjax
from vgtjax.parts import Bristle, Contact, Vanes
from vgtjax.sensitivity import force_along, parameter_slopes, starting_force, steady_force

FRICTION = vgtjax.LuGre()
NAMES = tuple(vgtjax.parameter_table(FRICTION))
SPEEDS = np.array([2e-4, 1e-3, 5e-3, 0.05])
NONE = jnp.zeros(())


def contact(velocity):
    return Contact(jnp.asarray(velocity), NONE, Vanes(NONE, NONE))


def integrated(velocity, time):
    """Force [4.6] at `time` under `velocity(t)` with Table B.2, written out and integrated by SciPy."""

    def sliding(t, z):
        v = velocity(t)
        return 43135 * np.abs(v) * z / (2.8 + 0.4 * np.exp(-np.abs(v) / 1e-3))

    time = np.asarray(time)
    z = solve_ivp(
        lambda t, z: velocity(t) - sliding(t, z), time[[0, -1]], [0.0], "LSODA", time, rtol=1e-11, atol=1e-17
    ).y[0]
    return 43135 * z + 429.77 * (velocity(time) - sliding(time, z)) + 206 * velocity(time)


@pytest.mark.parametrize("exponent", [1, 2])
def test_steady_sliding_is_what_a_settled_bristle_makes(exponent):
    friction = vgtjax.LuGre(stribeck_exponent=exponent)
    for speed in (*SPEEDS, *-SPEEDS):
        at = contact(speed)
        settled = Bristle(speed / friction.relaxation(at, friction.initial_state()).deflection)
        force, rate = friction(at, settled, NONE)
        assert rate.deflection == pytest.approx(0.0, abs=1e-17)  # rounding of a speed of 0.05
        assert steady_force(friction, speed) == pytest.approx(float(force), rel=1e-14)


def test_steady_sliding_at_the_thesis_speed():
    """`F_c + (F_s - F_c) e^-5 + sigma_2 v` with Table B.2."""
    assert steady_force(FRICTION, 0.005) == pytest.approx(2.8 + 0.4 * np.exp(-5) + 206 * 0.005, rel=1e-14)
    assert steady_force(FRICTION, 0.0) == 0.0


def test_slopes_of_steady_sliding_are_the_closed_ones():
    slopes = parameter_slopes(lambda friction: steady_force(friction, jnp.asarray(SPEEDS)), FRICTION)
    falling = np.exp(-SPEEDS / 1e-3)
    expected = {
        "static_force": falling,
        "coulomb_force": 1 - falling,
        "viscous_damping": SPEEDS,
        "stribeck_velocity": 0.4 * falling * SPEEDS / 1e-6,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(slopes[name], values, rtol=1e-12)  # rounding of exp
    for name in ("bristle_stiffness", "bristle_damping"):
        assert np.all(slopes[name] == 0.0), "settled bristles leave no trace"
    assert set(slopes) == {*expected, "bristle_stiffness", "bristle_damping"}


@pytest.mark.parametrize("velocity", [0.005, -0.005, 3e-4])
def test_a_start_solves_the_differential_equation(velocity):
    time = jnp.linspace(0.0, 5 * 3.2 / 43135 / abs(velocity), 41)
    exact = starting_force(FRICTION, velocity, time)
    # The integrator's 1e-11 of the deflection is 3e-11 N a step, of which there are a few hundred.
    np.testing.assert_allclose(exact, integrated(lambda t: velocity + 0 * t, time), atol=1e-8)


def test_a_start_begins_with_both_dampings_and_ends_sliding():
    velocity = 0.005
    assert starting_force(FRICTION, velocity, 0.0) == pytest.approx((429.77 + 206) * velocity, rel=1e-14)
    # The rate is 43135 * 0.005 / 2.8 = 77 1/s: e^-77 is left.
    assert starting_force(FRICTION, velocity, 1.0) == pytest.approx(float(steady_force(FRICTION, velocity)), rel=1e-14)


START = jnp.linspace(1e-4, 0.06, 13)
start = jax.jit(lambda friction: starting_force(friction, 0.005, START))


@pytest.fixture(scope="module")
def slopes_of_start():
    return jax.jit(lambda friction: parameter_slopes(start, friction))(FRICTION)


@pytest.mark.parametrize("name", NAMES)
def test_slopes_of_a_start_are_differences(name, slopes_of_start):
    value = float(getattr(FRICTION, name))
    up, down = (start(vgtjax.replace_parameters(FRICTION, {name: (1 + h) * value})) for h in (1e-5, -1e-5))
    # Central: the square of 1e-5 of truncation, and 1e-16 / 1e-5 of rounding of a force of some newtons.
    np.testing.assert_allclose(slopes_of_start[name], (up - down) / (2e-5 * value), rtol=1e-7, atol=1e-9 / value)


def test_bristles_act_before_sliding_and_not_in_it():
    early, late = 5e-3, 1.0
    time = jnp.asarray([early, late])
    slopes = jax.jit(lambda friction: parameter_slopes(lambda f: starting_force(f, 0.005, time), friction))(FRICTION)
    for name in ("bristle_stiffness", "bristle_damping"):
        change = np.abs(slopes[name]) * float(getattr(FRICTION, name))
        assert change[0] > 0.1  # N, were the parameter doubled
        assert change[1] < 1e-12


def test_a_rod_at_rest_has_no_friction_and_finite_slopes():
    time = jnp.asarray([0.0, 0.5])
    assert np.all(starting_force(FRICTION, 0.0, time) == 0.0)
    slopes = jax.jit(lambda friction: parameter_slopes(lambda f: starting_force(f, 0.0, time), friction))(FRICTION)
    for slope in slopes.values():
        assert np.all(np.isfinite(slope))


def to_and_fro(time):
    return 0.005 * np.sin(2 * np.pi * time / 2.0)


def test_a_path_converges_to_the_differential_equation_by_the_square_of_its_interval():
    every = np.linspace(0.0, 2.0, 8001)
    truth, errors = integrated(to_and_fro, every), []
    for stride in (4, 2, 1):
        time = every[::stride]
        path = jax.jit(force_along)(FRICTION, jnp.asarray(time), jnp.asarray(to_and_fro(time)))
        errors.append(np.max(np.abs(path - truth[::stride])))
    assert errors[-1] < 1e-5  # N, of 4
    # A quarter each time, but for what the integrator leaves.
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.3 * errors[1]


def test_a_path_at_constant_speed_is_a_start():
    time = jnp.linspace(0.0, 0.1, 11)
    path = jax.jit(force_along)(FRICTION, time, jnp.full_like(time, 0.005))
    # Eleven exponentials instead of one.
    np.testing.assert_allclose(path, starting_force(FRICTION, 0.005, time), rtol=1e-13)


def test_parameters_that_could_generate_energy_can_be_tried_in_a_batch():
    """Constructing them warns, which the tests turn into an error; a batch of values in a trace does not."""
    time = np.linspace(0.0, 0.1, 11)
    velocity = jnp.asarray(to_and_fro(time))

    def force(viscous):
        friction = vgtjax.replace_parameters(FRICTION, {"viscous_damping": viscous})
        return force_along(friction, jnp.asarray(time), velocity)

    least, most = jax.jit(jax.vmap(force))(jnp.asarray([20.6, 391.4]))
    # Linear in sigma_2; rounding of forces of some newtons.
    np.testing.assert_allclose(most - least, (391.4 - 20.6) * velocity, atol=1e-13)


@pytest.mark.parametrize("velocity", [np.zeros(3), np.zeros(()), np.zeros((4, 1))])
def test_a_path_has_one_velocity_a_sample(velocity):
    message = r"time and velocity must have the same shape \(time,\), but theirs are \(4,\) and \(.*\); give one"
    with pytest.raises(vgtjax.InputError, match=message):
        force_along(FRICTION, jnp.arange(4.0), jnp.asarray(velocity))
