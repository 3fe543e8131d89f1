"""The spread of units, freed of the errors with which each was found."""

import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import InputError, Selection
from vgtjax.estimation import Budget, Calibration, LeastSquares, first_progress, plan_task
from vgtjax.population import fitted_population, population_of_fits
from vgtjax.population._hierarchical import separate, separate_each

ENTRIES = ("diaphragm.mass", "diaphragm.preload", "diaphragm.stiffness", "friction.static_force")
MEAN = np.array([0.63, 49.0, 12000.0, 3.2])
SPREAD = np.array([0.06, 0.04, 0.05, 0.0])
"""Of the logarithm; of the preload relative. Static friction is the same in all units."""
COUNT = 60
PAIRED = np.eye(4)
PAIRED[0, 2] = PAIRED[2, 0] = 0.6


@pytest.fixture(scope="module")
def found():
    """Units, what fits found of them, and the covariance of the fits' errors: some larger than the spread."""
    rng = np.random.default_rng(11)
    relative = rng.multivariate_normal(np.zeros(4), PAIRED * SPREAD * SPREAD[:, None], COUNT)
    units = MEAN * np.where(np.arange(4) == 1, 1 + relative, np.exp(relative))
    estimates, covariances = [], []
    for unit in units:
        mixing = rng.normal(size=(4, 4)) * np.array([0.04, 0.01, 0.01, 0.08])[:, None] * rng.uniform(0.3, 1.5)
        errors = mixing @ mixing.T + 1e-8 * np.eye(4)
        off = rng.multivariate_normal(np.zeros(4), errors)
        estimate = unit * np.where(np.arange(4) == 1, 1 + off, np.exp(off))
        estimates.append(estimate)
        covariances.append(errors * estimate * estimate[:, None])
    return units, np.array(estimates), covariances


def population(estimates, covariances=None):
    selection = Selection(ENTRIES)
    models = [selection.unpack(vgtjax.Actuator(), jnp.asarray(estimate)) for estimate in estimates]
    return fitted_population(models, ENTRIES, covariances)


def deviations(population):
    """Relative ones, in the order of the entries; zero for what does not vary."""
    known = dict(zip(population.factors.entries, population.deviations / population.nominal, strict=True))
    return np.array([known.get(entry, 0.0) for entry in ENTRIES])


def test_spread_and_correlation_are_those_of_the_units(found):
    units, estimates, covariances = found
    freed, naive = population(estimates, covariances), population(estimates)
    truth = np.std(units, axis=0, ddof=1) / MEAN
    # Errors as large as the spread cost information: a third of its own for the mass, a tenth for what is well known.
    np.testing.assert_allclose(deviations(freed)[:3], truth[:3], rtol=0.3)
    np.testing.assert_allclose(deviations(freed)[1:3], truth[1:3], rtol=0.1)
    assert deviations(naive)[0] > 1.5 * truth[0]
    assert deviations(freed)[3] < 0.3 * deviations(naive)[3]
    at = [freed.factors.entries.index(entry) for entry in (ENTRIES[0], ENTRIES[2])]
    assert freed.correlation[tuple(at)] == pytest.approx(0.6, abs=0.3)
    assert np.all(np.linalg.eigvalsh(freed.correlation) > -1e-9)


def test_each_by_itself_where_factors_are_many(found):
    """As the joint model has it for what is well known, and no less than nothing for what only errors spread."""
    units, estimates, covariances = found
    values = np.log(estimates)
    relative = np.array([c / e / e[:, None] for c, e in zip(covariances, estimates, strict=True)])
    mean, spread = separate_each(values, np.einsum("uii->ui", relative))
    truth = np.std(np.log(units), axis=0, ddof=1)
    np.testing.assert_allclose(np.sqrt(spread)[1:3], truth[1:3], rtol=0.1)
    # Errors as large as the spread and no help from the others: half of it is two of its own errors.
    np.testing.assert_allclose(np.sqrt(spread)[0], truth[0], rtol=0.5)
    assert np.sqrt(spread)[3] < 0.3 * np.std(values[:, 3])
    np.testing.assert_allclose(mean[1:3], np.mean(np.log(units), axis=0)[1:3], atol=0.01)


def test_without_errors_it_is_the_plain_spread(found):
    units, *_ = found
    exact = [1e-14 * np.diag(unit**2) for unit in units]
    freed, naive = population(units, exact), population(units)
    # Iterations end a little short of a spread of zero.
    np.testing.assert_allclose(deviations(freed)[:3], deviations(naive)[:3], rtol=1e-3)
    assert deviations(freed)[3] < 1e-4


def test_what_a_unit_does_not_determine_has_no_say(found):
    """A value of 1e3 kg that nothing determined moves neither mean nor spread of the others."""
    _, estimates, covariances = found
    wild, blind = estimates.copy(), [covariance.copy() for covariance in covariances]
    wild[5, 0] = 1e3
    blind[5][0], blind[5][:, 0] = np.nan, np.nan
    others = [index for index in range(COUNT) if index != 5]
    without = population(estimates[others], [covariances[index] for index in others])
    # 59 units of the mass beside 60 of the others.
    np.testing.assert_allclose(deviations(population(wild, blind))[:3], deviations(without)[:3], rtol=0.05)


def test_what_no_unit_determines_does_not_spread(found):
    _, estimates, covariances = found
    blind = [covariance.copy() for covariance in covariances]
    for covariance in blind:
        covariance[0], covariance[:, 0] = np.nan, np.nan
    freed = population(estimates, blind)
    assert "diaphragm.mass" not in freed.factors.entries
    assert float(freed.model.diaphragm.mass) == pytest.approx(np.exp(np.log(estimates[:, 0]).mean()), rel=1e-9)


def test_a_spread_below_the_errors_settles():
    """Where all errors are alike the likeliest variance of the units is what they scatter by, less that of the errors;
    steps of the expectation-maximisation alone stopped at several times the spread."""
    values = np.random.default_rng(4).normal(size=(20, 2))
    values = (values - values.mean(axis=0)) / values.std(axis=0, ddof=1)
    error, spread = 0.1, np.array([0.02, 0.3])
    found = np.sqrt(spread**2 + error**2) * values
    # By 1e-4 of the scatter between units, of which the smaller variance is a twenty-fifth.
    each = separate_each(found, np.full((20, 2), error**2))[1]
    np.testing.assert_allclose(each, spread**2, rtol=3e-3)
    for column in range(2):
        one = separate(found[:, [column]], np.full((20, 1, 1), error**-2))[1]
        np.testing.assert_allclose(one[0, 0], spread[column] ** 2, rtol=3e-3)


def test_one_unit_says_nothing_of_a_spread(found):
    """Its own error stood as the spread of all."""
    _, estimates, covariances = found
    blind = [covariance.copy() for covariance in covariances]
    for covariance in blind[1:]:
        covariance[0], covariance[:, 0] = np.nan, np.nan
    assert ENTRIES[0] not in population(estimates, blind).factors.entries


def test_an_error_of_zero_is_a_value_that_is_known(found):
    """By another tool, or by hand: our own fits leave no such thing."""
    _, estimates, covariances = found
    exact = [covariance.copy() for covariance in covariances]
    for covariance in exact:
        covariance[0], covariance[:, 0] = 0.0, 0.0
    scatter = np.std(np.log(estimates[:, 0]), ddof=1)
    # The likeliest spread of what is known exactly is its scatter; a lognormal's relative one is larger by its square.
    assert deviations(population(estimates, exact))[0] == pytest.approx(scatter, rel=0.01)


def test_a_zero_that_is_known_exactly_stays_zero(found):
    """Its size says nothing of how well it is known."""
    _, estimates, covariances = found
    values, errors = estimates[:, [0, 1]].copy(), [each[:2, :2].copy() for each in covariances]
    values[:, 1] = 0.0
    for each in errors:
        each[1], each[:, 1] = 0.0, 0.0
    models = [Selection(ENTRIES[:2]).unpack(vgtjax.Actuator(), jnp.asarray(value)) for value in values]
    assert fitted_population(models, ENTRIES[:2], errors).factors.entries == ENTRIES[:1]


def fit_of(free, values, covariance):
    """What a fit would say that found these values, with an offset of a sensor, which is no part of the unit."""
    model = Selection(free).unpack(vgtjax.Actuator(), jnp.asarray(values))
    trace = duty_trace((0, 0.05), (70, 0.35), p_res=2.0e4, x_d=0.0, p_act=101013.0)
    task = plan_task(model, [trace], free=free)
    known, nothing = np.diag(covariance) > 0, np.zeros(len(free))
    assert task.selection.entries == free
    return Calibration(
        model=model,
        task=task,
        transform=task.transform(),
        progress=first_progress(task),
        values=np.asarray(values),
        covariance=covariance,
        uncertainty=LeastSquares(nothing, covariance, known, np.zeros((0, len(free))), 1.0, 0.0),
        traces=[],
        count=1,
        sensors=[],
        budget=Budget(nothing, nothing, {}, nothing, 0.1),
    )


def test_fits_are_a_population_in_one_call(found):
    """A fit has zeros for what it does not determine, which would be a value known for certain."""
    _, estimates, covariances = found
    estimates, covariances = estimates[:8], [covariance.copy() for covariance in covariances[:8]]
    for row in (covariances[2][0], covariances[2][:, 0]):
        row[:] = 0.0
    fits = [fit_of(ENTRIES, *each) for each in zip(estimates, covariances, strict=True)]
    assert np.all(np.isnan(fits[2].error_covariance[0]))
    assert np.all(np.isfinite(fits[2].error_covariance[1:, 1:]))
    blind = [covariance.copy() for covariance in covariances]
    blind[2][0], blind[2][:, 0] = np.nan, np.nan
    found, expected = population_of_fits(fits), population(estimates, blind)
    assert found.factors.entries == expected.factors.entries
    np.testing.assert_array_equal(found.nominal, expected.nominal)
    np.testing.assert_array_equal(found.correlation, expected.correlation)


def test_only_what_was_free_in_all_fits_can_vary(found):
    _, estimates, covariances = found
    fits = [fit_of(ENTRIES, *each) for each in zip(estimates[:5], covariances, strict=False)]
    part = fit_of(ENTRIES[2:], estimates[5, 2:], covariances[5][2:, 2:])
    assert "diaphragm.mass" in population_of_fits(fits).factors.entries
    assert set(population_of_fits([*fits, part]).factors.entries) <= set(ENTRIES[2:])
    with pytest.raises(InputError, match="needs three fitted units or more, but there are 0"):
        population_of_fits([])
