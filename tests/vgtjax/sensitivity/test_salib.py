"""The same samples and outputs through SALib, the reference implementation of these indices."""

import numpy as np
import pytest
from SALib.analyze import morris as morris_analysis, radial_ee, sobol as sobol_analysis
from SALib.sample import morris as morris_sample, sobol as sobol_sample
from sensitivity_systems import GFunction, Ishigami

from vgtjax.sensitivity import RadialDesign, elementary_effects, first_order, total_order

FUNCTIONS = {"Ishigami": (Ishigami(), Ishigami().inputs), "G": (GFunction(), lambda u: u)}


def problem(dimensions):
    return {
        "num_vars": dimensions,
        "names": [f"u{i}" for i in range(dimensions)],
        "bounds": [[0.0, 1.0]] * dimensions,
    }


def test_rows_are_in_the_order_of_salib():
    design = RadialDesign(dimensions=4, base=16, seed=11)
    theirs = sobol_sample.sample(problem(4), 16, calc_second_order=False, seed=np.random.default_rng(11))
    # Ours lie in the middle of cells of 2^-30, theirs at the lower end.
    np.testing.assert_allclose(design.points(0, design.rows), theirs, atol=2.0**-30, rtol=0)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_variance_based_indices_agree(name):
    """Total indices to rounding; first-order ones to rounding once the centre is the same.

    SALib centres with the mean of all rows, we with that of A and B: the first-order index, the mean of
    `(b - centre)(ab - a)`, differs by the difference of centres times the mean of `ab - a`.
    """
    function, inputs = FUNCTIONS[name]
    design = RadialDesign(function.dimensions, 256, 2)
    y = function(inputs(design.points(0, design.rows)))
    a, ab, b = design.split(y[:, None])
    theirs = sobol_analysis.analyze(problem(design.dimensions), y, calc_second_order=False, num_resamples=2, seed=1)
    np.testing.assert_allclose(total_order(a, ab, b)[0], theirs["ST"], rtol=1e-10)  # rounding
    both = np.concatenate([a, b])
    shift = (y.mean() - both.mean()) * np.mean(ab[:, :, 0] - a, axis=0) / both.var()
    np.testing.assert_allclose(first_order(a, ab, b)[0] - shift, theirs["S1"], rtol=1e-10, atol=1e-12)  # rounding
    assert np.max(np.abs(shift)) < 1e-3  # the difference of formulas is no difference of results


def test_elementary_effects_agree_on_the_same_radial_steps():
    function = Ishigami()
    design = RadialDesign(3, 32, seed=4)
    u_a, u_b = design.base_points(0, 32)
    assert np.min(np.abs(u_b - u_a)) > 0.01  # SALib leaves no step out
    u = design.points(0, design.rows)
    y = function(function.inputs(u))
    kept = np.arange(design.rows) % design.members < design.members - 1  # without B, which SALib does not take
    theirs = radial_ee.analyze(problem(3), u[kept], y[kept], 32, num_resamples=2, seed=1)
    a, ab, _ = design.split(y[:, None])
    ours = elementary_effects(u_a, u_b, a, ab)
    for name in ("mu", "mu_star", "sigma"):
        np.testing.assert_allclose(getattr(ours, name)[0], theirs[name], rtol=1e-10)  # rounding


def multilinear(u):
    """Every elementary effect is linear in the other inputs, so that only their means matter, not their levels."""
    return u @ [3.0, -2.0, 0.0, 1.0] + 4 * u[:, 0] * u[:, 1] + 2 * u[:, 2] * u[:, 3]


def test_radial_steps_and_trajectories_expect_the_same_effects():
    points = morris_sample.sample(problem(4), 2000, num_levels=4, seed=1)
    theirs = morris_analysis.analyze(problem(4), points, multilinear(points), num_resamples=2, seed=1)
    design = RadialDesign(4, 2048, seed=1)
    a, ab, _ = design.split(multilinear(design.points(0, design.rows))[:, None])
    ours = elementary_effects(*design.base_points(0, 2048), a, ab)
    mean = [3.0 + 4 * 0.5, -2.0 + 4 * 0.5, 2 * 0.5, 1.0 + 2 * 0.5]
    size = [mean[0], 4 * 0.25, mean[2], mean[3]]  # the second changes its sign at 1/2; E |u - 1/2| = 1/4
    # Trajectories of four levels have |u - 1/2| of 1/6 and 1/2, 1/3 in the mean, so the second is left out of mu_star.
    same = [0, 2, 3]
    # The standard error of a mean of 2000 effects between 3 and 7 is 1.2/sqrt(2000) = 0.026; three of them.
    np.testing.assert_allclose(ours.mu[0], mean, atol=0.08)
    np.testing.assert_allclose(theirs["mu"], mean, atol=0.11)  # levels have a larger deviation, by 1.3
    np.testing.assert_allclose(ours.mu_star[0], size, atol=0.08)
    np.testing.assert_allclose(np.asarray(theirs["mu_star"])[same], ours.mu_star[0, same], atol=0.11)
