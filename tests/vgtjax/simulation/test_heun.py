"""The integration method on systems whose solution and its derivatives are known in closed form."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import StabilisedHeun
from vgtjax.simulation._heun import _Excess


class Relaxing(eqx.Module):
    """`y' = -rate (y - target)`: the solution is `target + (1 - target) exp(-rate t)`."""

    rate: jax.Array
    target: jax.Array

    def field(self, t, y, args):
        return -self.rate * (y - self.target)

    def exact(self, t):
        return self.target + (1 - self.target) * jnp.exp(-self.rate * t)


def solve(system, steps, solver=None):
    solver = StabilisedHeun(lambda t, y, args: system.rate) if solver is None else solver
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(system.field),
        solver,
        t0=0.0,
        t1=1.0,
        dt0=1.0 / steps,
        y0=jnp.asarray(1.0),
        max_steps=steps + 1,
        adjoint=diffrax.ForwardMode(),
    )
    return solution.ys[-1]


def system(rate):
    return Relaxing(jnp.asarray(rate), jnp.asarray(0.3))


def test_without_excess_it_is_exactly_heun():
    slow = system(20.0)
    assert solve(slow, 100) == pytest.approx(float(solve(slow, 100, diffrax.Heun())), rel=1e-14)


@pytest.mark.parametrize("limit", [1.5, 0.0])
def test_second_order_with_and_without_excess(limit):
    """Halving the step quarters the error, both of Heun's method and of the part that takes the excess."""
    moderate = system(3.0)
    solver = StabilisedHeun(lambda t, y, args: jnp.asarray(5.0), limit=limit)
    errors = [abs(float(solve(moderate, n, solver) - moderate.exact(1.0))) for n in (50, 100, 200)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.35)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.35)


@pytest.mark.parametrize("rate", [3e2, 1e4, 1e7])
def test_stays_stable_where_heun_explodes(rate):
    stiff = system(rate)
    assert solve(stiff, 100) == pytest.approx(0.3, abs=1e-3)
    assert not abs(solve(stiff, 100, diffrax.Heun())) < 10


@pytest.mark.parametrize("rate", [3.0, 60.0])
def test_derivatives_by_parameters_are_the_closed_form(rate):
    start = system(rate)
    ours = jax.jacfwd(lambda s: solve(s, 4000))(start)
    exact = jax.jacfwd(lambda s: s.exact(1.0))(start)
    np.testing.assert_allclose(ours.rate, exact.rate, rtol=1e-4, atol=1e-12)  # error of order (rate/4000)^2
    np.testing.assert_allclose(ours.target, exact.target, rtol=1e-4)


@pytest.mark.parametrize("stage", [lambda e: e.predict(0.3, 0.2), lambda e: e.correct(0.3, 0.5, 0.7)])
@pytest.mark.parametrize("excess", [1e-3, 0.4, 7.0, 3e4])
def test_derivative_by_the_excess_is_that_of_differences(stage, excess):
    def moved(z):
        return stage(_Excess(z, 1.0, 0.0))

    step = 1e-5 * excess
    differences = (moved(excess + step) - moved(excess - step)) / (2 * step)
    # Differences of these steps are off by 1e-10 of themselves, and by the rounding of values near one over the step.
    assert jax.grad(moved)(excess) == pytest.approx(float(differences), rel=1e-7, abs=1e-15 / step)


def test_switch_between_the_two_is_continuous():
    """At `h rate = limit` nothing may jump, or gradients through a fit would be wrong."""
    below, above = system(150.0 * (1 - 1e-9)), system(150.0 * (1 + 1e-9))
    assert solve(below, 100) == pytest.approx(float(solve(above, 100)), rel=1e-7)


def test_error_estimate_lets_an_adaptive_controller_steer():
    smooth = system(5.0)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(smooth.field),
        StabilisedHeun(lambda t, y, args: smooth.rate),
        t0=0.0,
        t1=1.0,
        dt0=None,
        y0=jnp.asarray(1.0),
        stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6),
    )
    assert solution.ys[-1] == pytest.approx(float(smooth.exact(1.0)), abs=1e-5)
