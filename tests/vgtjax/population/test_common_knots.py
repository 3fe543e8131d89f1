"""Fitted units whose tables stand on different knots."""

import dataclasses

import numpy as np
import pytest

import vgtjax
from vgtjax import Selection
from vgtjax.plants import on_given_knots
from vgtjax.population import FittedUnit, fitted_population, population_of_units
from vgtjax.population._common_knots import on_common_knots

CLOSING = tuple(f"vane_force.closing[{k}]" for k in range(12))
PRESSURES = "vane_force.turbine_pressure"


@pytest.fixture(scope="module")
def units() -> list[FittedUnit]:
    """Five with a table over two turbine pressures and six angles, each known to a percent, and their masses."""
    rng, found = np.random.default_rng(5), []
    table = np.add.outer([3.0, 6.0], np.linspace(0.0, 1.0, 6)).ravel()
    entries = ("diaphragm.mass", *CLOSING)
    for level in rng.normal(1.0, 0.1, 5):
        values = np.append(0.6 * level, table * level * rng.normal(1.0, 0.02, 12))
        vanes = vgtjax.HysteresisMap(closing=np.zeros(12), opening=np.zeros(12))
        model = Selection(entries).unpack(vgtjax.Actuator(vane_force=vanes), values)
        mixing = rng.normal(size=(13, 13)) * 0.003 * values[:, None]
        found.append(FittedUnit(model, entries, mixing @ mixing.T))
    return found


def with_a_knot_more(unit: FittedUnit) -> FittedUnit:
    """The same model, told as well at half the first pressure, where the force is half of that."""
    pressures = np.asarray(vgtjax.get_parameter(unit.model, PRESSURES))
    model = on_given_knots(unit.model, {PRESSURES: [0.5 * pressures[0], *pressures]})
    half = np.zeros((6, 13))
    half[np.arange(6), 1 + np.arange(6)] = 0.5
    slopes = np.insert(np.eye(13), 1, half, axis=0)
    entries = ("diaphragm.mass", *(f"vane_force.closing[{k}]" for k in range(18)))
    np.testing.assert_allclose(Selection(entries).values(model), slopes @ Selection(unit.entries).values(unit.model))
    return FittedUnit(model, entries, slopes @ unit.covariance @ slopes.T)


def test_a_knot_that_says_nothing_more_changes_nothing(units):
    plain = fitted_population([unit.model for unit in units], units[0].entries, [unit.covariance for unit in units])
    found = population_of_units([units[0], with_a_knot_more(units[1]), *units[2:]])
    assert found.factors.entries == plain.factors.entries
    # But for rounding of what is read at the knots of the first.
    np.testing.assert_allclose(found.nominal, plain.nominal, rtol=1e-9)
    np.testing.assert_allclose(found.deviations, plain.deviations, rtol=1e-6)


def test_all_stand_on_the_knots_of_the_first(units):
    """The highest pressure had dropped out, as its entries have other numbers."""
    plain = population_of_units(units)
    found = population_of_units([with_a_knot_more(units[0]), *units[1:]])
    spreads = [dict(zip(each.factors.entries, each.deviations, strict=True)) for each in (plain, found)]
    for k in range(12):
        # Each by itself, as there are fewer units than entries: the same numbers at the same pressures.
        assert spreads[1][f"vane_force.closing[{k + 6}]"] == pytest.approx(spreads[0][CLOSING[k]], rel=1e-3)
    for k in range(6):
        assert spreads[1][CLOSING[k]] == pytest.approx(0.5 * spreads[0][CLOSING[k]], rel=1e-3)


def test_what_was_not_determined_or_not_free_is_neither_at_other_knots(units):
    unknown = with_a_knot_more(units[1])
    errors = unknown.covariance.copy()
    errors[7], errors[:, 7] = np.nan, np.nan  # the first angle at the first of the pressures that all have
    moved = on_common_knots([units[0], dataclasses.replace(unknown, covariance=errors)])[1]
    assert moved.entries == list(units[1].entries)
    lost = np.isnan(moved.covariance)
    assert np.array_equal(lost, np.logical_or.outer(np.arange(13) == 1, np.arange(13) == 1))
    np.testing.assert_allclose(moved.covariance[~lost], units[1].covariance[~lost], rtol=1e-9)
    held = FittedUnit(unknown.model, unknown.entries[:7], unknown.covariance[:7, :7])
    assert population_of_units([units[0], held, *units[2:]]).factors.entries == ("diaphragm.mass",)


def test_knots_that_were_free_are_no_quantities_of_units_that_were_moved(units):
    """They are where the first unit's are, without an error of their own."""
    several = []
    for unit in (units * 4)[:18]:
        entries = (*unit.entries, f"{PRESSURES}[0]", f"{PRESSURES}[1]")
        errors = np.zeros((15, 15))
        errors[:13, :13], errors[13:, 13:] = unit.covariance, 1e4 * np.eye(2)
        several.append(FittedUnit(unit.model, entries, errors))
    pressures = np.asarray(vgtjax.get_parameter(units[0].model, PRESSURES))
    other = on_given_knots(several[1].model, {PRESSURES: 1.1 * pressures})
    found = population_of_units([several[0], dataclasses.replace(several[1], model=other), *several[2:]])
    assert found.factors.entries == units[0].entries
    again = population_of_units(several, like=other)
    np.testing.assert_array_equal(vgtjax.get_parameter(again.model, PRESSURES), 1.1 * pressures)
    assert again.factors.entries == units[0].entries
