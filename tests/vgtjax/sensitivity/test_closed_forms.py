"""Every index against its closed form."""

import numpy as np
import pytest
from sensitivity_systems import GFunction, Ishigami

from vgtjax.sensitivity import (
    NORMAL,
    UNIFORM,
    RadialDesign,
    correlations,
    elementary_effects,
    first_order,
    gradient_share,
    regress,
    squared_correlation,
    total_bound,
    total_order,
    variance,
)

# Table 4.2: the Coulomb friction that was varied, and the friction force that is printed beside it.
COULOMB = np.linspace(1.6, 2.6, 21)
PRINTED = """
3.12437 3.15273 3.13912 3.13694 3.12016 3.13653 3.14267 3.13882 3.120923 3.13546 3.13146
3.12983 3.12872 3.140013 3.122054 3.13342 3.128341 3.13901 3.14385 3.14237 3.13874
"""
FORCE = np.array(PRINTED.split(), dtype=float)


def radial(function, base, seed=1, inputs=lambda u: u):
    """A design with the outputs of a function at it."""
    design = RadialDesign(function.dimensions, base, seed)
    x = inputs(design.points(0, design.rows))
    return design, x, function(x)[:, None]


def test_variance_based_indices_of_ishigami():
    function = Ishigami()
    design, _, y = radial(function, 4096, inputs=function.inputs)
    # Over 20 seeds the largest error is 0.027 of the first-order index and 0.005 of the total one.
    np.testing.assert_allclose(first_order(*design.split(y))[0], function.first, atol=0.03)
    np.testing.assert_allclose(total_order(*design.split(y))[0], function.total, atol=0.01)


def test_variance_based_indices_of_the_g_function():
    function = GFunction()
    design, _, y = radial(function, 4096)
    # Over 20 seeds the largest error is 0.003 and 0.004.
    np.testing.assert_allclose(first_order(*design.split(y))[0], function.first, atol=0.01)
    np.testing.assert_allclose(total_order(*design.split(y))[0], function.total, atol=0.01)


def test_an_offset_takes_no_digits():
    function = GFunction()
    design, _, y = radial(function, 64)
    for index in (first_order, total_order):
        # Outputs near 1e6 are rounded to 1e-10; squared without a centre they would be to 1e-4.
        np.testing.assert_allclose(index(*design.split(y + 1e6)), index(*design.split(y)), atol=1e-9)


def test_an_input_that_does_nothing_has_no_total_index_at_all():
    design = RadialDesign(2, 64, 1)
    y = np.exp(design.points(0, design.rows)[:, :1])
    assert total_order(*design.split(y))[0, 1] == 0.0
    assert first_order(*design.split(y))[0, 1] == 0.0


def test_constant_outputs_have_no_shares_but_no_effects():
    design = RadialDesign(2, 64, 1)
    y = np.full((design.rows, 1), 0.1)
    x = design.points(0, design.rows)
    for index in (first_order, total_order):
        assert np.all(np.isnan(index(*design.split(y))))
    assert np.all(np.isnan(squared_correlation(x, y)))
    assert np.all(np.isnan(regress(x, y).r2))
    assert np.all(np.isnan(regress(x, y).coefficients))
    a, ab, _ = design.split(y)
    assert np.all(elementary_effects(*design.base_points(0, 64), a, ab).mu_star == 0.0)


def test_squared_correlation_of_ishigami():
    function = Ishigami()
    x = function.inputs(RadialDesign(3, 2048, 1).base_points(0, 2048)[0])
    y = function(x)[:, None]
    # Over 20 seeds the largest error is 0.0024.
    np.testing.assert_allclose(squared_correlation(x, y)[0], function.squared_correlation, atol=0.005)


def test_the_printed_index_of_table_4_2_does_not_follow_from_its_columns():
    index = squared_correlation(COULOMB[:, None], FORCE[:, None]).item()
    assert index == pytest.approx(np.corrcoef(COULOMB, FORCE)[0, 1] ** 2, rel=1e-12)  # rounding
    assert index == pytest.approx(0.004, abs=0.0005)  # 0.3945 is printed; digits of the erratum


def test_variance_is_that_of_4_2():
    assert variance(FORCE[:, None]).item() == pytest.approx(np.mean((FORCE - FORCE.mean()) ** 2), rel=1e-12)  # rounding


def correlated_inputs(rows=200):
    """Inputs with correlations up to 0.9 and scales from 1e-6 to 1e6, centred on any place."""
    rng = np.random.default_rng(4)
    mixing = np.array([[1.0, 0.0, 0.0], [0.9, 0.44, 0.0], [-0.3, 0.2, 1.0]])
    return (rng.normal(size=(rows, 3)) @ mixing.T) * [1e-6, 1.0, 1e6] + [1e-5, -3.0, 1e7]


def test_regression_finds_a_linear_model_of_correlated_inputs():
    x = correlated_inputs()
    slopes = np.array([[2e6, -1.0, 3e-6], [0.0, 5.0, 0.0]])
    y = x @ slopes.T + 7.0
    found = regress(x, y)
    # Rounding of 1e-16 times the condition of the inputs, about 50, and a ridge of 1e-12.
    np.testing.assert_allclose(found.coefficients, slopes * x.std(axis=0) / y.std(axis=0)[:, None], atol=1e-10)
    np.testing.assert_allclose(found.r2, 1.0, atol=1e-10)
    np.testing.assert_allclose(found.adjusted_r2, 1.0, atol=1e-10)


def test_regression_is_the_least_squares_solution_with_noise():
    x = correlated_inputs()
    y = (x / x.std(axis=0)) @ np.array([[1.0], [-2.0], [0.5]]) + np.random.default_rng(5).normal(size=(200, 1))
    found = regress(x, y)
    scaled = np.column_stack([np.ones(200), (x - x.mean(axis=0)) / x.std(axis=0)])
    solution, residual, *_ = np.linalg.lstsq(scaled, y)
    np.testing.assert_allclose(found.coefficients[0], solution[1:, 0] / y.std(), rtol=1e-9)  # the ridge of 1e-12
    r2 = 1 - residual[0] / np.sum((y - y.mean()) ** 2)
    assert found.r2[0] == pytest.approx(r2, rel=1e-9)
    assert found.adjusted_r2[0] == pytest.approx(1 - (1 - r2) * 199 / 196, rel=1e-9)


def test_uncorrelated_inputs_have_the_same_index_by_correlation_and_by_regression():
    x = np.linalg.qr(np.random.default_rng(0).normal(size=(50, 4)) @ np.eye(4))[0]
    x = np.linalg.qr(x - x.mean(axis=0))[0]
    y = np.exp(10 * x[:, :2])
    np.testing.assert_allclose(regress(x, y).coefficients ** 2, squared_correlation(x, y), atol=1e-10)  # the ridge


def test_regression_survives_constant_and_repeated_inputs():
    x = correlated_inputs()[:, :2]
    y = x @ [[1e6], [1.0]]
    more = np.column_stack([x[:, 0], x[:, 0], x[:, 1], np.full(200, 0.3)])
    found, alone = regress(more, y), regress(x, y)
    expected = alone.coefficients[0, [0, 0, 1]] * [0.5, 0.5, 1.0]
    np.testing.assert_allclose(found.coefficients[0, :3], expected, atol=1e-10)  # the ridge
    assert found.coefficients[0, 3] == 0.0
    np.testing.assert_allclose(found.adjusted_r2, 1.0, atol=1e-10)
    assert squared_correlation(more, y)[0, 3] == 0.0


def test_an_input_that_others_determine_is_no_unknown():
    x = correlated_inputs()
    rng = np.random.default_rng(1)
    y = (x / x.std(axis=0)) @ np.ones((3, 1)) + rng.normal(size=(200, 1))
    more = np.column_stack([x, (x / x.std(axis=0)) @ rng.normal(size=(3, 6))])
    np.testing.assert_allclose(regress(more, y).adjusted_r2, regress(x, y).adjusted_r2, rtol=1e-9)  # the ridge


def test_regression_with_more_inputs_than_points_has_no_adjusted_r2():
    rng = np.random.default_rng(0)
    found = regress(rng.normal(size=(5, 8)), rng.normal(size=(5, 2)))
    assert np.all(np.isnan(found.adjusted_r2))
    np.testing.assert_allclose(found.r2, 1.0, atol=1e-9)  # four directions fit five centred points; the ridge


def test_signs_of_correlations():
    x = np.random.default_rng(0).normal(size=(50, 1))
    np.testing.assert_allclose(correlations(x, np.hstack([2 * x, -3 * x])).ravel(), [1.0, -1.0], rtol=1e-12)  # rounding


class Polynomials:
    """Outputs whose elementary effects have known statistics."""

    dimensions = 2
    mu = np.array([[3.0, -2.0], [0.5, 0.5], [0.0, 0.0]])
    mu_star = np.array([[3.0, 2.0], [0.5, 0.5], [1 / 3, 0.0]])
    sigma = np.array([[0.0, 0.0], [1 / np.sqrt(12), 1 / np.sqrt(12)], [1 / np.sqrt(6), 0.0]])

    @staticmethod
    def outputs(u):
        return np.stack([3 * u[:, 0] - 2 * u[:, 1], u[:, 0] * u[:, 1], (u[:, 0] - 0.5) ** 2], axis=1)


def test_elementary_effects_of_polynomials():
    design = RadialDesign(2, 4096, 1)
    a, ab, _ = design.split(Polynomials.outputs(design.points(0, design.rows)))
    found = elementary_effects(*design.base_points(0, 4096), a, ab)
    # Two of a hundred steps are left out, all of them short; their effects are 1/2 instead of 1/3 in the mean, so
    # that 0.0034 is missing. The rest is sampling, 0.5/sqrt(4096) if it were random.
    for name in ("mu", "mu_star", "sigma"):
        np.testing.assert_allclose(getattr(found, name), getattr(Polynomials, name), atol=0.01)
    np.testing.assert_allclose(found.mu[0], [3.0, -2.0], rtol=1e-12)  # linear: no sampling error at all
    np.testing.assert_allclose(found.sigma[0], 0.0, atol=1e-12)


def test_a_short_step_does_not_blow_up_the_error_of_a_simulation():
    u_a = np.linspace(0.1, 0.8, 40)[:, None]
    u_b = u_a + 0.1
    u_b[7] = u_a[7] + 1e-7
    a, ab = u_a, u_b[:, :, None].copy()
    ab[7] += 1e-3
    found = elementary_effects(u_a, u_b, a, ab)
    np.testing.assert_allclose(found.mu_star, 1.0, rtol=1e-12)  # rounding; 250 if the step counted
    np.testing.assert_allclose(found.sigma, 0.0, atol=1e-7)  # the root of rounding


@pytest.mark.parametrize("steps", [0, 1])
def test_inputs_with_less_than_two_steps_have_no_effects(steps):
    u_a = np.full((20, 1), 0.5)
    u_b = u_a + 0.001
    u_b[:steps] += 0.3
    found = elementary_effects(u_a, u_b, np.zeros((20, 1)), np.ones((20, 1, 1)))
    assert np.all(np.isnan([found.mu, found.mu_star, found.sigma]))


def test_gradient_share_of_a_linear_model():
    gradients = np.array([[3.0, -2.0e3], [0.0, 0.0]])
    found = gradient_share(gradients, np.array([2.0, 1e-3]))
    np.testing.assert_allclose(found[0], [36 / 40, 4 / 40], rtol=1e-12)  # rounding
    assert np.all(np.isnan(found[1]))


def test_derivative_bound_is_the_total_index_of_a_linear_model_of_normal_inputs():
    slopes, deviations = np.array([[1.0, -3.0]]), np.array([2.0, 0.5])
    gradients = np.broadcast_to(slopes, (10, 1, 2))
    whole = np.sum((slopes * deviations) ** 2, axis=1)
    found = total_bound(gradients, deviations, whole, NORMAL)
    np.testing.assert_allclose(found[0], [4 / 6.25, 2.25 / 6.25], rtol=1e-12)  # rounding


def test_derivative_bound_of_ishigami():
    function = Ishigami()
    x = function.inputs(RadialDesign(3, 4096, 1).base_points(0, 4096)[0])
    deviations = np.full(3, np.pi / np.sqrt(3))
    bound = total_bound(function.gradients(x)[:, None], deviations, np.array([function.variance]), UNIFORM)[0]
    # 12/pi^2 of the variance pi^2/3 is 4. Over 20 seeds the largest error is 2e-4.
    np.testing.assert_allclose(bound, 4 * function.mean_square_gradient / function.variance, rtol=1e-3)
    assert np.all(bound > function.total)


def test_poincare_constant_of_a_uniform_distribution_is_sharp():
    """Of all functions, half a wave of the cosine has the least mean square slope for its variance."""
    u = (np.arange(10000) + 0.5)[:, None] / 10000
    gradients = -np.pi * np.sin(np.pi * u)[:, None]
    bound = total_bound(gradients, np.array([1 / np.sqrt(12)]), variance(np.cos(np.pi * u)), UNIFORM)
    np.testing.assert_allclose(bound, 1.0, rtol=1e-10)  # midpoint sums of whole waves are exact but for rounding
