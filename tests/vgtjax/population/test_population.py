"""Populations: what varies, by which distribution and together with what, and what fitted units say about it."""

import math

import jax
import numpy as np
import pytest
import scipy.special
import scipy.stats
from support import quick_nozzle

import vgtjax
from vgtjax import InputError, replace_parameters
from vgtjax.plants import assemble
from vgtjax.population import (
    Factors,
    Population,
    SobolSample,
    Spread,
    choose_factors,
    lognormal,
    normal,
    spread_population,
    triangular,
    uniform,
)
from vgtjax.population._population import _factor, domain

ACTUATOR = vgtjax.Actuator()
MAGNET = "converter.magnetic_force"
NAMES = ("diaphragm.area", "diaphragm.preload", "diaphragm.stiffness")
FACTORS = Factors(NAMES)
COUPLED = np.array([[1.0, 0.6, -0.4], [0.6, 1.0, 0.1], [-0.4, 0.1, 1.0]])
MARGINS = (lognormal(2.9e-3, 0.1), normal(49.0, 2.0), uniform(1.1e4, 1.3e4))


def population(correlation=None, margins=MARGINS, factors=FACTORS):
    return Population(ACTUATOR, factors, margins, correlation)


def points(rows, columns=3, seed=0):
    return np.random.default_rng(seed).uniform(size=(rows, columns))


# What varies.


def test_unpack_puts_back_what_pack_took():
    factors = choose_factors(ACTUATOR, ["diaphragm.*", MAGNET, "converter.atmosphere_orifice[1]"])
    values = np.asarray(factors.pack(ACTUATOR))
    assert values[factors.entries.index(MAGNET)] == 1.0
    assert values[factors.entries.index("diaphragm.stiffness")] == 12000.0
    assert values[factors.entries.index("converter.atmosphere_orifice[1]")] == 1.68e-4
    same = factors.unpack(ACTUATOR, factors.pack(ACTUATOR))
    assert all(map(np.array_equal, jax.tree.leaves(same), jax.tree.leaves(ACTUATOR)))


def test_a_vector_varies_as_a_whole_and_an_entry_by_its_value():
    factors = Factors((MAGNET, "converter.atmosphere_orifice[1]", "diaphragm.area"))
    other = factors.unpack(ACTUATOR, np.array([1.1, 2e-4, 3e-3]))
    np.testing.assert_allclose(
        vgtjax.get_parameter(other, MAGNET), 1.1 * vgtjax.get_parameter(ACTUATOR, MAGNET), rtol=1e-15
    )
    np.testing.assert_array_equal(other.converter.atmosphere_orifice, [2.299e-8, 2e-4, 0.342])
    assert other.diaphragm.area == 3e-3
    assert factors.units(ACTUATOR) == ["1", "m", "m2"]
    assert not Factors(()).pack(ACTUATOR).size


def test_factors_are_in_the_order_of_the_table():
    chosen = choose_factors(ACTUATOR, ["friction.*", "chamber.volume", f"{MAGNET}[3]", f"{MAGNET}[0]"])
    assert chosen.entries[:3] == (f"{MAGNET}[0]", f"{MAGNET}[3]", "chamber.volume")
    assert chosen.entries[3:] == tuple(n for n in vgtjax.parameter_table(ACTUATOR) if n.startswith("friction."))


def test_what_is_fixed_stays():
    assert choose_factors(ACTUATOR, ["diaphragm.*"], ["diaphragm.[!p]*"]).entries == ("diaphragm.preload",)
    assert choose_factors(ACTUATOR, ["chamber.*", MAGNET], [MAGNET]).entries == ("chamber.volume",)
    assert choose_factors(ACTUATOR, ["chamber.*", f"{MAGNET}[1]"], [MAGNET]).entries == ("chamber.volume",)
    assert choose_factors(ACTUATOR, [f"{MAGNET}[1]", f"{MAGNET}[2]"], [f"{MAGNET}[1]"]).entries == (f"{MAGNET}[2]",)


@pytest.mark.parametrize(
    ("patterns", "fixed", "sentence"),
    [
        ([MAGNET, f"{MAGNET}[2]"], [], r"'converter.magnetic_force\[2\]' and the whole .* can't both vary; name one"),
        ([MAGNET], [f"{MAGNET}[2]"], r"\[2\]' and the whole 'converter.magnetic_force' can't be fixed and vary"),
        (["diaphragm.stifness"], [], "'diaphragm.stifness' matches nothing; did you mean 'diaphragm.stiffness'"),
        ([MAGNET], ["nothing.*"], r"'nothing.\*' matches nothing"),
    ],
)
def test_factors_that_contradict_each_other_are_refused(patterns, fixed, sentence):
    with pytest.raises(InputError, match=sentence):
        choose_factors(ACTUATOR, patterns, fixed)


# Distributions.


@pytest.mark.parametrize(
    ("margin", "mean", "deviation"),
    [
        (normal(5.0, 2.0), 5.0, 2.0),
        (normal(1.0, 0.1, (0.0, math.inf)), 1.0, 0.1),  # cut off ten deviations away
        # Half of a normal: mean s sqrt(2 / pi), deviation s sqrt(1 - 2 / pi).
        (normal(0.0, 3.0, (0.0, math.inf)), 3 * math.sqrt(2 / math.pi), 3 * math.sqrt(1 - 2 / math.pi)),
        (lognormal(4.0, 0.3), 4 * math.exp(0.045), 4 * math.exp(0.045) * math.sqrt(math.exp(0.09) - 1)),
        (uniform(2.0, 8.0), 5.0, 6 / math.sqrt(12)),
        (triangular(1.0, 2.0, 6.0), 3.0, math.sqrt((1 + 4 + 36 - 2 - 12 - 6) / 18)),
    ],
)
def test_margins_have_their_moments(margin, mean, deviation):
    single = population(None, (margin,), Factors(NAMES[:1]))
    assert single.deviations == pytest.approx([deviation], rel=1e-9)
    grid = (np.arange(4000)[:, None] + 0.5) / 4000  # equal shares of probability, by their middles
    values = single.values(grid)
    # Middles of the outermost shares miss some of the tails' spread: 4e-4 of a lognormal's.
    assert values.mean() == pytest.approx(mean, rel=1e-4)
    assert values.std() == pytest.approx(deviation, rel=1e-3)


def test_a_truncated_quantity_never_leaves_its_domain():
    edge = np.array([[5e-324], [1e-300], [1e-16], [0.5], [1 - 1e-12]])
    for mean, low in ((0.1, 0.0), (-1.0, 0.0), (5.0, 2.0)):
        values = population(None, (normal(mean, 1.0, (low, math.inf)),), Factors(NAMES[:1])).values(edge)
        assert np.all(values >= low)
        above = mean - scipy.special.ndtri((1 - edge) * scipy.special.ndtr(mean - low))
        # Seven deviations out, 1e-16 of a probability is 1e-4 of what is left of it.
        np.testing.assert_allclose(values, above, rtol=1e-5, atol=1e-12)
        assert np.all(np.diff(values[:, 0]) >= 0)


def test_domains_are_those_of_the_table():
    assert domain(ACTUATOR, "diaphragm.stiffness") == (0.0, math.inf)
    assert domain(ACTUATOR, "diaphragm.damping") == (0.0, math.inf)
    assert domain(ACTUATOR, "diaphragm.preload") == (-math.inf, math.inf)
    assert domain(ACTUATOR, f"{MAGNET}[2]") == (-math.inf, math.inf)
    assert domain(ACTUATOR, MAGNET) == (0.0, math.inf)  # the level of a curve does not change its sign


# Correlation.

ROWS = 20_000
ERROR = 4 / math.sqrt(ROWS)
"""Four standard errors of a correlation near zero; larger ones have smaller errors."""


def test_normal_quantities_have_the_stated_correlation():
    margins = tuple(normal(mean, 1.0) for mean in (1.0, 2.0, 3.0))
    found = np.corrcoef(population(COUPLED, margins).values(points(ROWS)), rowvar=False)
    np.testing.assert_allclose(found, COUPLED, atol=ERROR)


def test_other_quantities_have_the_rank_correlation_of_a_gaussian_copula():
    """`6 / pi arcsin(rho / 2)` (Pearson, 1907), whatever the margins."""
    found = scipy.stats.spearmanr(population(COUPLED).values(points(ROWS))).statistic
    np.testing.assert_allclose(found, 6 / math.pi * np.arcsin(COUPLED / 2), atol=ERROR)


def test_scores_are_combined_by_a_factor_of_the_correlation():
    """`L L^T`, with `L` read off column by column; its rows have length one, which leaves the distributions alone."""
    standard = population(COUPLED, (normal(0.0, 1.0),) * 3)
    columns = standard.values(scipy.stats.norm.cdf(np.eye(3)))
    np.testing.assert_allclose(columns.T @ columns, COUPLED, atol=1e-13)  # rounding of cdf and ppf
    np.testing.assert_array_equal(standard.values(np.full((1, 3), 0.5)), np.zeros((1, 3)))


def test_without_correlation_quantities_are_independent():
    alone = population(COUPLED).independent()
    assert alone.correlation is None
    np.testing.assert_array_equal(alone.values(points(50)), population().values(points(50)))
    np.testing.assert_array_equal(alone.values(points(50))[:, 1], MARGINS[1].ppf(points(50)[:, 1]))


def test_full_correlation_moves_quantities_as_one():
    ones = np.ones((3, 3))
    scores = [margin.cdf(column) for margin, column in zip(MARGINS, population(ones).values(points(50)).T, strict=True)]
    # Square roots of rounding in the two eigenvalues that are zero.
    np.testing.assert_allclose(scores[1:], [scores[0]] * 2, atol=1e-7)


@pytest.mark.parametrize("coupled", [False, True])
def test_a_row_is_the_same_to_the_bit_in_every_slice(coupled):
    """Many quantities: a matrix product would round otherwise for a single row."""
    factors = choose_factors(ACTUATOR, ["diaphragm.*", "friction.*", "converter.*_area"])
    size = len(factors.entries)
    kinds = (lognormal(2.9e-3, 0.1), normal(1.0, 1.0, (0.0, math.inf)), triangular(1.0, 2.0, 4.0))
    correlation = np.full((size, size), 0.3) + 0.7 * np.eye(size) if coupled else None
    varied = population(correlation, tuple(kinds[i % 3] for i in range(size)), factors)
    cube = points(203, size)
    whole = varied.values(cube)
    for rows in (1, 8):
        parts = [varied.values(cube[begin : begin + rows]) for begin in range(0, len(cube), rows)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_the_corners_of_the_cube_are_where_their_quantiles_lead():
    """Normal deviates of up to 38, mixed as the correlation says, as far as doubles tell probabilities."""
    corners = np.array([[5e-324] * 3, [np.nextafter(1, 0)] * 3, [5e-324, 0.5, np.nextafter(1, 0)]])
    ends = scipy.special.ndtri([np.finfo(float).tiny, 1 - np.finfo(float).epsneg])
    deviates = np.clip(scipy.special.ndtri(corners) @ _factor(COUPLED).T, *ends)
    expected = np.stack([2.9e-3 * np.exp(0.1 * deviates[:, 0]), 49.0 + 2.0 * deviates[:, 1]], axis=1)
    values = population(COUPLED).values(corners)
    np.testing.assert_allclose(values[:, :2], expected, rtol=1e-6)
    np.testing.assert_allclose(values[:, 2], 1.1e4 + 2e3 * scipy.special.ndtr(deviates[:, 2]), rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            {"correlation": np.array([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]])},
            r"contradict each other \(smallest eigenvalue -0.8, which must not be negative\); weaken them",
        ),
        ({"correlation": np.eye(2)}, r"must be 3 by 3, but it is \(2, 2\); give that"),
        ({"correlation": np.triu(np.ones((3, 3)))}, "must be symmetric with ones on its diagonal"),
        ({"correlation": 2 * np.eye(3)}, "must be symmetric with ones on its diagonal"),
        ({"margins": MARGINS[:2]}, "one distribution a quantity, but it has 2 for 3; give one each"),
    ],
)
def test_a_population_that_can_not_be_is_refused(arguments, sentence):
    with pytest.raises(InputError, match=sentence):
        population(**arguments)


# Tolerances.

AREA, PRELOAD, STIFFNESS = NAMES


def test_by_default_all_that_has_a_size_varies_by_two_percent():
    table = vgtjax.parameter_table(ACTUATOR)
    found = spread_population(ACTUATOR)
    left_out = set(table) - set(found.factors.entries)
    assert all(name.startswith(("air.", "diaphragm.stop_")) for name in left_out - {"diaphragm.damping"})  # it is zero
    assert found.correlation is None
    # Cut off at zero, fifty deviations away.
    np.testing.assert_allclose(found.deviations, 0.02 * np.abs(found.nominal), rtol=1e-9)


def test_what_varies_is_chosen_by_pattern_and_by_spread():
    found = spread_population(
        ACTUATOR, 0.05, vary=["diaphragm.*"], fixed=["diaphragm.stop_*"], spreads={"chamber.volume": Spread()}
    )
    assert set(found.factors.entries) == {"chamber.volume", "diaphragm.mass", "diaphragm.travel", *NAMES}
    np.testing.assert_allclose(found.deviations, 0.05 * np.abs(found.nominal), rtol=1e-9)


@pytest.mark.parametrize(
    ("spread", "same"),
    [
        (Spread(), normal(12000.0, 1200.0, (0.0, math.inf))),
        (Spread(deviation=300.0), normal(12000.0, 300.0)),
        (Spread(relative=0.02, lower=11900.0), normal(12000.0, 240.0, (11900.0, math.inf))),
        (Spread("lognormal", relative=0.3), lognormal(12000.0, math.sqrt(math.log((1 + math.sqrt(1.36)) / 2)))),
        (Spread("uniform", relative=0.25), uniform(9000.0, 15000.0)),
        (Spread("uniform", lower=11000.0, upper=20000.0), uniform(11000.0, 20000.0)),
        (Spread("triangular", deviation=1000.0, upper=15000.0), triangular(11000.0, 12000.0, 15000.0)),
    ],
)
def test_a_spread_is_a_distribution_around_the_nominal_value(spread, same):
    (margin,) = spread_population(ACTUATOR, 0.1, vary=[STIFFNESS], spreads={STIFFNESS: spread}).margins
    shares = np.linspace(0.01, 0.99, 25)
    np.testing.assert_allclose(margin.ppf(shares), same.ppf(shares), rtol=1e-12)


@pytest.mark.parametrize("distribution", ["normal", "lognormal"])
def test_a_relative_spread_is_the_standard_deviation_as_a_part_of_the_nominal_value(distribution):
    spread = Spread(distribution, relative=0.2)
    (margin,) = spread_population(ACTUATOR, vary=[STIFFNESS], spreads={STIFFNESS: spread}).margins
    # What a normal one is cut off at zero, five deviations away, is beyond these digits.
    assert margin.median() == pytest.approx(12000.0, rel=1e-5)
    assert margin.std() == pytest.approx(2400.0, rel=1e-4)


def test_correlations_are_stated_by_pairs_or_groups():
    stated = [((AREA, STIFFNESS), 0.6), ((STIFFNESS, PRELOAD), -0.4)]
    found = spread_population(ACTUATOR, vary=NAMES, correlations=stated)
    at = {name: place for place, name in enumerate(found.factors.entries)}
    expected = np.eye(3)
    for (one, other), value in stated:
        expected[at[one], at[other]] = expected[at[other], at[one]] = value
    np.testing.assert_array_equal(found.correlation, expected)
    group = spread_population(ACTUATOR, vary=NAMES, correlations=[(NAMES, 0.3)]).correlation
    np.testing.assert_array_equal(group, np.full((3, 3), 0.3) + 0.7 * np.eye(3))


@pytest.mark.parametrize(
    ("arguments", "sentence", "argument"),
    [
        (
            {"spreads": {STIFFNESS: Spread("gauss")}},
            f"distribution of '{STIFFNESS}' must be one of normal, lognormal, uniform, triangular, but it is 'gauss'",
            "spreads",
        ),
        ({"spreads": {STIFFNESS: Spread(relative=-0.1)}}, "must be positive, but it is -0.1; correct it", "spreads"),
        ({"relative": math.nan}, "must be positive, but it is nan; correct it", "relative"),
        ({"spreads": {STIFFNESS: Spread("lognormal", lower=1.0)}}, "has no ends, but lower or upper is", "spreads"),
        ({"spreads": {PRELOAD: Spread("lognormal")}}, "must be positive, but it is -5; choose another", "spreads"),
        ({"vary": []}, "needs a quantity that varies, but vary and fixed leave none; vary one", "vary"),
        ({"fixed": [AREA], "spreads": {AREA: Spread()}}, f"'{AREA}' can't be fixed and have a spread", "fixed"),
        ({"correlations": [((AREA, "air.pressure"), 0.3)]}, "'air.pressure' has a correlation but does not", "correl"),
    ],
)
def test_tolerances_that_can_not_be_are_refused(arguments, sentence, argument):
    slack = replace_parameters(ACTUATOR, {PRELOAD: -5.0})
    with pytest.raises(InputError, match=sentence) as raised:
        spread_population(slack, **arguments)
    assert raised.value.argument.startswith(argument)


def test_members_are_those_that_can_exist():
    """Chambers from half of what the diaphragm sweeps on, at the first points of the sample of a seed."""
    spread = Spread("uniform", lower=1.5e-5, upper=6.0e-5)
    population = spread_population(ACTUATOR, spreads={"chamber.volume": spread}, vary=[])
    members = population.members(20, seed=4)
    volumes = population.values(SobolSample(1, 20, 4).points(0, 20))[:, 0]
    swept = float(ACTUATOR.diaphragm.area * ACTUATOR.diaphragm.travel)
    assert members.names == tuple(f"sample {number}" for number in range(20))
    lost = {name for name, volume in zip(members.names, volumes, strict=True) if volume < swept}
    assert 3 < len(lost) < 17
    assert members.refused == dict.fromkeys(members.refused, "the diaphragm swallows the chamber")
    assert set(members.refused) == lost
    assert set(members.models) == set(members.names) - lost
    for name, model in members.models.items():
        assert float(model.chamber.volume) == volumes[members.names.index(name)]


def test_a_member_whose_nozzle_does_not_work_is_refused():
    thick = "vane_force.nozzle.thickness"
    with quick_nozzle():
        plant = assemble(vgtjax.Actuator(), vane_force=vgtjax.Turbine())
        population = spread_population(plant, spreads={thick: Spread(deviation=6e-4, lower=1e-5)}, vary=[])
        members = population.members(9, seed=0)
    assert set(members.refused.values()) == {"the nozzle does not work"}
    assert 0 < len(members.models) < 9
    # Vanes of 0.3 mm leave 0.59 mm when closed.
    assert all(float(model.vane_force.nozzle.thickness) < 0.89e-3 for model in members.models.values())


def test_no_members_are_refused():
    with pytest.raises(InputError, match="the size of a sample must be between 1 and"):
        spread_population(ACTUATOR).members(0)
