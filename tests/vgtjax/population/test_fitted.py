"""Populations of fitted units: their mean, spread and correlation, and their members."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import vgtjax
from vgtjax import InputError, Selection, get_parameter, replace_parameters
from vgtjax.population import (
    fitted_levels,
    fitted_population,
    make_sample,
    spread_population,
)

ACTUATOR = vgtjax.Actuator()
MAGNET = "converter.magnetic_force"
ROWS = 20_000
ERROR = 4 / math.sqrt(ROWS)
"""Four standard errors of a correlation near zero."""
ENTRIES = ("converter.magnetic_force[2]", "diaphragm.area", "diaphragm.preload", "diaphragm.stiffness")
TRUTH = (3.9e-3, 2.9e-3, 49.0, 12000.0)
SPREAD = (1e-4, 0.0, 2.0, 0.08)
"""Of the logarithm for the stiffness, which is positive; the area is the same in all units."""
PAIRED = np.array([[1.0, -0.7, 0.0], [-0.7, 1.0, 0.4], [0.0, 0.4, 1.0]])


def points(rows, columns=3, seed=0):
    return np.random.default_rng(seed).uniform(size=(rows, columns))


def unit(entries, values):
    return Selection(tuple(entries)).unpack(ACTUATOR, jnp.asarray(values))


@pytest.fixture(scope="module")
def fleet():
    """Units whose magnetic force, preload and stiffness are drawn together."""
    scores = np.random.default_rng(7).multivariate_normal(np.zeros(3), PAIRED, size=300)
    force, preload = TRUTH[0] + SPREAD[0] * scores[:, 0], TRUTH[2] + SPREAD[2] * scores[:, 1]
    stiffness = TRUTH[3] * np.exp(SPREAD[3] * scores[:, 2])
    return [unit(ENTRIES, row) for row in np.column_stack([force, np.full(300, TRUTH[1]), preload, stiffness])]


def test_fitted_units_give_mean_spread_and_correlation_back(fleet):
    found = fitted_population(fleet, ENTRIES)
    assert found.factors.entries == (ENTRIES[0], ENTRIES[2], ENTRIES[3])  # the area does not vary
    assert found.model.diaphragm.area == pytest.approx(TRUTH[1], rel=1e-14)
    assert vgtjax.get_parameter(found.model, MAGNET)[1] == vgtjax.get_parameter(ACTUATOR, MAGNET)[1]
    count, errors = len(fleet), 4.0  # four standard errors each, of a mean, a deviation and a correlation
    spread = np.array([SPREAD[0], SPREAD[2], SPREAD[3] * TRUTH[3]])
    truth = np.array([TRUTH[0], TRUTH[2], TRUTH[3]])
    assert np.all(np.abs(found.nominal - truth) < errors * spread / math.sqrt(count))
    # The deviation of a lognormal is a little more than the logarithm's: 0.5 % at 8 %.
    np.testing.assert_allclose(found.deviations, spread, rtol=errors / math.sqrt(2 * count) + 0.005)
    assert found.deviations[1] == pytest.approx(np.std([m.diaphragm.preload for m in fleet], ddof=1), rel=1e-12)
    np.testing.assert_allclose(found.correlation, PAIRED, atol=errors / math.sqrt(count))
    values = found.values(points(ROWS))
    np.testing.assert_allclose(np.corrcoef(values, rowvar=False), found.correlation, atol=ERROR + 0.003)  # lognormal
    assert np.median(values[:, 2]) == pytest.approx(found.nominal[2], rel=errors * 0.08 / math.sqrt(ROWS) * 1.3)


def test_errors_of_a_logarithm_beside_small_numbers_take_nothing_away():
    """A coefficient of 1e-8 N/Pa^2 whose error is 1e-11 stands beside a logarithm that is hardly known."""
    entries, count = (f"{MAGNET}[4]", "diaphragm.preload", "diaphragm.stop_damping"), 60
    truth, errors = np.array([1e-8, 49.0, np.log(1300.0)]), np.array([1e-11, 0.1, 1.0])
    spread = np.array([5e-10, 2.0, 0.3])
    rng = np.random.default_rng(11)
    scores = truth + spread * rng.normal(size=(count, 3))
    found = scores + errors * rng.normal(size=(count, 3))
    rows = np.column_stack([found[:, :2], np.exp(found[:, 2])])
    covariances = [np.diag((errors * np.where([False, False, True], row, 1.0)) ** 2) for row in rows]
    population = fitted_population([unit(entries, row) for row in rows], entries, covariances)
    assert population.factors.entries[:2] == entries[:2]
    # Four standard errors of a mean and of a deviation; errors are small beside the spread of the first two.
    assert np.all(np.abs(population.nominal[:2] - truth[:2]) < 4 * spread[:2] / math.sqrt(count))
    np.testing.assert_allclose(population.deviations[:2], spread[:2], rtol=4 / math.sqrt(2 * count))


def test_few_units_span_their_samples():
    """Five units of eight entries: samples are combinations of the units, in logarithms where positive."""
    entries = [f"{MAGNET}[{k}]" for k in range(5)] + ["diaphragm.preload", "diaphragm.stiffness", "chamber.volume"]
    nominal = np.asarray(Selection(tuple(entries)).pack(ACTUATOR))
    units = nominal * (1 + 0.05 * np.random.default_rng(2).normal(size=(5, 8)))
    found = fitted_population([unit(entries, row) for row in units], entries)
    assert found.factors.entries == tuple(entries)

    def scores(values):
        logs = np.column_stack([values[:, :6], np.log(values[:, 6:])])
        reference = np.column_stack([units[:, :6], np.log(units[:, 6:])])
        return (logs - reference.mean(axis=0)) / reference.std(axis=0, ddof=1)

    samples = scores(found.values(points(100, 8)))
    basis = np.linalg.svd(scores(units))[2][:4]  # five units about their mean
    outside = samples - samples @ basis.T @ basis
    # Square roots of rounding in the eigenvalues that are zero.
    assert np.abs(outside).max() < 1e-6
    assert np.linalg.matrix_rank(samples, tol=1e-5) == 4
    np.testing.assert_allclose(samples.std(axis=0), 1.0, atol=4 / math.sqrt(200))  # four standard errors


def test_levels_are_one_factor_a_curve(fleet):
    """Curves that are multiples of the nominal one by known factors."""
    levels = np.array([0.9, 1.0, 1.04, 1.1])
    force = np.asarray(vgtjax.get_parameter(ACTUATOR, MAGNET))
    stiffness = 12000 * np.array([0.95, 1.0, 1.1, 1.0])
    units = [
        replace_parameters(ACTUATOR, {MAGNET: level * force, "diaphragm.stiffness": k})
        for level, k in zip(levels, stiffness, strict=True)
    ]
    coupled = fitted_population(units, [*(f"{MAGNET}[{k}]" for k in range(5)), "diaphragm.stiffness"])
    found = fitted_levels(coupled)
    assert found.factors.entries == (MAGNET, "diaphragm.stiffness")
    assert found.correlation is None
    # The curve at factor one is the units' mean curve, 1.01 times the printed one.
    np.testing.assert_allclose(found.nominal, [1.0, np.exp(np.log(stiffness).mean())], rtol=1e-12)
    np.testing.assert_allclose(get_parameter(found.model, MAGNET), 1.01 * force, rtol=1e-12)
    # A multiple of all coefficients is one of their mean, whose relative spread stands for that of the logarithm.
    wanted = np.std(levels / 1.01, ddof=1), np.log(stiffness).std(ddof=1)
    for margin, deviation in zip(found.margins, wanted, strict=True):
        spread = math.log(margin.ppf(0.975) / margin.ppf(0.025)) / (2 * scipy.stats.norm.ppf(0.975))
        assert spread == pytest.approx(deviation, rel=1e-9)


def test_a_level_is_the_nearest_multiple():
    """A unit whose table has another shape counts with its projection on the mean one."""
    name, curve = "vane_force.closing", np.arange(1.0, 13.0)
    base = vgtjax.Actuator(vane_force=vgtjax.HysteresisMap(closing=curve, opening=np.zeros(12)))
    across = np.array([2.0, -1.0, *np.zeros(10)])
    tables = np.array([0.95 * curve, curve, 1.05 * curve + across])
    units = [replace_parameters(base, {name: each}) for each in tables]
    (margin,) = fitted_levels(fitted_population(units, [f"{name}[{k}]" for k in range(12)])).margins
    mean = tables.mean(axis=0)
    # A lognormal of that spread of the logarithm: equal to the square of a twentieth.
    assert margin.std() == pytest.approx(np.std(tables @ mean / (mean @ mean), ddof=1), rel=0.05**2)


def test_a_level_is_freed_of_the_errors_of_the_fits(fleet):
    """As every other quantity: scatter that the errors explain is no spread, and what nothing determined has no say."""
    levels, rng = np.linspace(0.95, 1.05, 12), np.random.default_rng(3)
    force = np.asarray(vgtjax.get_parameter(ACTUATOR, MAGNET))
    error = 0.04 * np.abs(force)
    found = levels[:, None] * force + rng.normal(0, error, (12, 5))
    units = [
        replace_parameters(ACTUATOR, {MAGNET: each, "diaphragm.mass": m})
        for each, m in zip(found, (1, 90) * 6, strict=True)
    ]
    covariance = np.diag(np.append(error**2, np.nan))
    covariance[5] = covariance[:, 5] = np.nan
    known = fitted_population(units, [*(f"{MAGNET}[{k}]" for k in range(5)), "diaphragm.mass"], [covariance] * 12)
    levelled = fitted_levels(known)
    assert levelled.factors.entries == (MAGNET,)
    # A dozen units know a spread to a fifth of it.
    assert levelled.deviations[0] == pytest.approx(np.std(levels, ddof=1), rel=0.25)


def test_two_units_are_no_population(fleet):
    with pytest.raises(InputError, match="needs three fitted units or more, but there are 2; fit more"):
        fitted_population(fleet[:2], ENTRIES)


def test_units_with_nothing_in_common_or_nothing_that_spreads_are_refused(fleet):
    with pytest.raises(InputError, match="fitted in all of its units, but there is none"):
        fitted_population(fleet[:3], ())
    nothing = [np.full((4, 4), np.nan)] * 3
    with pytest.raises(InputError, match="spreads between them, but there is none"):
        fitted_population(fleet[:3], ENTRIES, nothing)
    with pytest.raises(InputError, match="spreads between them, but there is none"):
        fitted_population([fleet[0]] * 3, ENTRIES)


def test_no_member_has_friction_that_gives_out_energy():
    """Viscous damping is raised to the least of passive friction, and nothing else is touched."""
    wide = spread_population(ACTUATOR, 0.5, vary=["friction.*"])
    loose = dataclasses.replace(wide, passive=False)
    points = make_sample(wide.dimensions, 512, "sobol", 3).points(0, 512)
    values, drawn, active = wide.values(points), loose.values(points), wide.active(points)
    assert 20 < active.sum() < 492
    at = wide.factors.entries.index("friction.viscous_damping")
    np.testing.assert_array_equal(np.delete(values, at, axis=1), np.delete(drawn, at, axis=1))
    np.testing.assert_array_equal(values[~active], drawn[~active])
    for row in values[active][:8]:
        friction = wide.factors.unpack(ACTUATOR, row).friction
        # On the bound, but for rounding and the billionth that keeps it inside.
        assert 0 <= float(friction.passivity_margin()) < 1e-6 * float(friction.viscous_damping)
    assert not spread_population(ACTUATOR, 0.5, vary=["diaphragm.mass"]).active(points[:, :1]).any()


@pytest.mark.parametrize("vary", [["friction.*"], ["friction.bristle_damping", "friction.static_force"]])
def test_no_member_has_friction_that_can_give_out_energy_whether_its_viscous_damping_varies_or_not(vary):
    wide = spread_population(ACTUATOR, 0.5, vary=vary)
    loose = dataclasses.replace(wide, passive=False)
    sample = points(64, len(wide.factors.entries))

    def margins(population):
        rows = population.values(sample)
        return np.array([population.factors.unpack(ACTUATOR, row).friction.passivity_margin() for row in rows])

    assert np.sum(margins(loose) < 0) == np.sum(wide.active(sample)) > 5
    assert np.all(margins(wide) >= 0)
    # Only those that needed it, and by no more than that and a billionth of up to thousands of N s/m.
    np.testing.assert_allclose(margins(wide), np.maximum(margins(loose), 0.0), atol=1e-5)
    assert all(model.friction.is_passive for model in wide.members(16).models.values())
