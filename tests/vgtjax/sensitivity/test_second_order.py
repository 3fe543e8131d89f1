"""The corrected step response of the frictionless diaphragm against its differential equation [4.3-4.5]."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vgtjax
from vgtjax.sensitivity import damping_ratio, frictionless_diaphragm, natural_frequency, step_response

PRINTED = frictionless_diaphragm(vgtjax.Diaphragm(), vgtjax.LuGre())
CRITICAL = float(2 * jnp.sqrt(PRINTED.mass * PRINTED.stiffness))
PRESSURE = 2e4
TIME = np.linspace(0.0, 0.2, 101)
RATIOS = (0.0, 0.3, 0.999999, 1.0, 1.000001, 1.185, 3.0, 40.0)
"""Damping over the critical one: none, below, at, next to, above, far above."""
PARAMETERS = ("area", "mass", "stiffness", "damping")

respond = jax.jit(lambda part: step_response(part, PRESSURE, jnp.asarray(TIME)))
slopes = jax.jit(jax.jacfwd(lambda part: step_response(part, PRESSURE, jnp.asarray(TIME))))


def damped(ratio):
    return vgtjax.replace_parameters(PRINTED, {"damping": ratio * CRITICAL})


def integrated(part, tolerance=1e-12):
    """Position by numerical integration of m x'' + b x' + k x = A p."""
    area, mass, stiffness, damping = (float(getattr(part, name)) for name in PARAMETERS)

    def rates(_, state):
        return [state[1], (area * PRESSURE - damping * state[1] - stiffness * state[0]) / mass]

    return solve_ivp(rates, TIME[[0, -1]], [0.0, 0.0], "DOP853", TIME, rtol=tolerance, atol=tolerance * 1e-3).y[0]


def settled(part):
    return float(part.area / part.stiffness) * PRESSURE


def motion(part, time):
    """Position and velocity."""
    return jnp.stack(jax.jvp(lambda t: step_response(part, PRESSURE, t), (time,), (1.0,)))


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_response_solves_the_differential_equation(ratio):
    part = damped(ratio)
    # 1e-12 of the integrator in each of some thousand steps at most.
    np.testing.assert_allclose(respond(part), integrated(part), atol=1e-9 * settled(part))


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("name", PARAMETERS)
def test_every_derivative_is_the_difference_of_integrations(ratio, name):
    part = damped(ratio)
    value = float(getattr(part, name))
    # The difference's own error is (omega_n t 1e-4)^2 / 6 = 1.3e-6; the integrator leaves 1e-11 / 1e-4.
    size = 1e-4 * (value or CRITICAL)
    # Past the end of the domain, where no part can be built.
    shifted = [eqx.tree_at(lambda p: getattr(p, name), part, jnp.asarray(value + sign * size)) for sign in (1, -1)]
    difference = (integrated(shifted[0]) - integrated(shifted[1])) / (2 * size)
    exact = getattr(slopes(part), name)
    np.testing.assert_allclose(exact, difference, atol=2e-6 * np.max(np.abs(difference)))


def test_at_critical_damping_it_is_the_textbook_solution():
    part = damped(1.0)
    passed = float(natural_frequency(part)) * TIME
    expected = settled(part) * (1 - (1 + passed) * np.exp(-passed))
    # A critical damping that is rounded is off by 1e-16, of which the solution is a smooth function.
    np.testing.assert_allclose(respond(part), expected, atol=1e-14 * settled(part))


def test_derivatives_pass_smoothly_through_critical_damping():
    """Derivatives to second order at the critical point are limits of those beside it, where (4.4) is plain."""

    def by_damping(damping):
        return step_response(vgtjax.replace_parameters(PRINTED, {"damping": damping}), PRESSURE, 0.02)

    def orders(damping):
        return by_damping(damping), jax.grad(by_damping)(damping), jax.grad(jax.grad(by_damping))(damping)

    below, at, above = np.array(jax.jit(jax.vmap(orders))(CRITICAL * jnp.asarray([1 - 1e-4, 1.0, 1 + 1e-4]))).T
    # A smooth function equals the mean of its neighbours but for the square of their distance.
    np.testing.assert_allclose(at, (below + above) / 2, rtol=1e-7)
    # Not by being zero: position, slope and curvature differ from nothing by far more than they differ here.
    np.testing.assert_array_less(1e-5, np.abs(above - below) / np.abs(at))


def test_the_branches_meet_where_the_series_ends():
    """`u = (b t / 2 m)^2 - k t^2 / m` is 1 or -1 there; slopes from both sides agree."""

    for part in (PRINTED, damped(0.3)):
        u = float((part.damping / (2 * part.mass)) ** 2 - part.stiffness / part.mass)
        edge = abs(u) ** -0.5 * jnp.asarray([1 - 1e-13, 1 + 1e-13])
        # The function itself moves by 1e-13 between them.
        for left, right in jax.jit(jax.vmap(lambda time, part=part: motion(part, time), out_axes=1))(edge):
            assert left == pytest.approx(float(right), rel=1e-11)


def test_it_equals_the_corrected_equation_where_that_is_real():
    frequency, ratio = float(natural_frequency(PRINTED)), float(damping_ratio(PRINTED))
    a, b = (frequency * (ratio + sign * np.sqrt(ratio**2 - 1)) for sign in (-1, 1))
    expected = settled(PRINTED) * (1 - (np.exp(-a * TIME) / a - np.exp(-b * TIME) / b) / (1 / a - 1 / b))
    # The differences lose one digit.
    np.testing.assert_allclose(respond(PRINTED), expected, atol=1e-14 * settled(PRINTED))


def test_the_printed_sign_does_not_start_at_rest():
    """(4.4) with its sign of the slow exponential begins far beyond the end, and moves; the corrected one rests."""
    frequency, ratio = float(natural_frequency(PRINTED)), float(damping_ratio(PRINTED))
    root = np.sqrt(ratio**2 - 1)

    def start(sign_of_slow):
        rates = np.array([ratio - root, ratio + root])
        weights = np.array([sign_of_slow, 1.0]) / rates / (2 * root)
        return 1 + weights.sum(), -frequency * (weights * rates).sum()

    position, velocity = start(1.0)
    assert position == pytest.approx(1 + ratio / root)
    assert velocity == pytest.approx(-frequency / root)
    np.testing.assert_allclose(start(-1.0), 0.0, atol=1e-12)  # rounding of sums of numbers up to 200
    assert np.all(motion(PRINTED, 0.0) == 0.0)


def test_the_printed_spring_pushes_away_from_rest():
    """(4.3) has `+ k_sm x_d`: its motion grows, whatever the damping."""
    roots = np.roots([float(PRINTED.mass), float(PRINTED.damping), -float(PRINTED.stiffness)])
    assert roots.max() > 50


def test_all_viscous_damping_acts_once():
    assert float(PRINTED.damping) == 206.0
    assert damping_ratio(PRINTED) == pytest.approx(206 / (2 * np.sqrt(0.63 * 12000)))
    both = frictionless_diaphragm(vgtjax.Diaphragm(damping=10.0), vgtjax.LuGre())
    assert float(both.damping) == 216.0


def test_what_was_overdamped_long_ago_does_not_overflow():
    """`cosh` of ten thousand is infinite; the response has settled."""
    assert step_response(damped(40.0), PRESSURE, 1e3) == pytest.approx(settled(PRINTED), rel=1e-12)
    late = slopes_at(1e3)
    assert float(late.area) == pytest.approx(settled(PRINTED) / float(PRINTED.area), rel=1e-12)
    assert float(late.damping) == 0.0


def slopes_at(time):
    return jax.grad(lambda part: step_response(part, PRESSURE, time))(damped(40.0))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mass", 0.0, r"diaphragm.mass must be positive for the step response \[4.4\], but it is 0; give such a value"),
        ("stiffness", 0.0, r"diaphragm.stiffness must be positive for the step response \[4.4\], but it is 0;"),
    ],
)
def test_what_has_no_such_response_is_refused(name, value, message):
    with pytest.raises(vgtjax.InputError, match=message):
        step_response(vgtjax.replace_parameters(PRINTED, {name: value}), PRESSURE, 0.02)
