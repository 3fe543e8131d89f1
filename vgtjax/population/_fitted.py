"""The population behind fitted units: mean, spread and correlation of their parameters."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..estimation import Calibration
from ..parameters import Selection, entry_names, get_parameter, parameter_table
from ..plants import AbstractModel
from ._common_knots import FittedUnit, on_common_knots
from ._factors import Factors, is_curve
from ._hierarchical import separate, separate_each
from ._population import Margin, Population, domain, lognormal, normal

SMALLEST = 1e-12
"""Relative spread below which a quantity is the same in all units."""
LEAST_SQUARE = 1e-100
"""Of a value whose error is a part of itself: what it is divided by stays finite."""


def fitted_population(
    models: Sequence[AbstractModel],
    entries: Sequence[str],
    covariances: Sequence[Float[np.ndarray, "entries entries"]] | None = None,
) -> Population:
    """The population that fitted units are a sample of.

    Positive quantities are lognormal, others normal, around the units' mean (geometric for positive ones). With the
    `covariances` of the fits, spread and correlation are those of the units themselves (a hierarchical normal model);
    without, the errors of the fits are in them.

    **Arguments:** `models`: the units, alike but for their values; `entries`: what was fitted, entry by entry;
    `covariances`: of each unit's errors in the units of the table, NaN for what its traces do not determine.

    **Raises:** `InputError` for fewer than three units, nothing that was fitted in all of them, or nothing that
    spreads.
    """
    if len(models) < 3:
        raise InputError(f"a population needs three fitted units or more, but there are {len(models)}; fit more")
    if not entries:
        raise InputError(
            "a population needs a quantity that was fitted in all of its units, but there is none; fit them alike"
        )
    selection = Selection(tuple(entries))
    units = np.stack([selection.values(model) for model in models])
    ends = [domain(models[0], entry) for entry in entries]
    positive = np.array([low == 0.0 for low, _ in ends]) & np.all(units > 0, axis=0)
    if covariances is None:
        mean, deviation, scores = _moments(units, positive)
        correlation = scores.T @ scores / (len(units) - 1)
    else:
        mean, deviation, correlation = _without_errors(units, positive, np.stack(covariances))
    differ = np.ptp(units, axis=0) > 0
    chosen = np.flatnonzero(differ & (deviation > SMALLEST * np.where(positive, 1.0, np.abs(mean)))).tolist()
    if not chosen:
        raise InputError(
            "a population needs a quantity that its units determine and that spreads between them, but there is none; "
            "give other units, or tolerances",
            "models",
        )
    correlation = correlation[np.ix_(chosen, chosen)]
    np.fill_diagonal(correlation, 1.0)
    return Population(
        selection.unpack(models[0], jnp.asarray(mean)),
        Factors(tuple(entries[i] for i in chosen)),
        tuple(_margin(mean[i], deviation[i], bool(positive[i]), ends[i]) for i in chosen),
        correlation,
    )


def population_of_fits(fits: Sequence[Calibration]) -> Population:
    """The population that the units of some fits are a sample of, freed of the errors of the fits.

    [`fitted_population`][vgtjax.population.fitted_population] of every entry of their plants that was free in all of
    them, with `error_covariance` of each.

    **Arguments:** `fits`: of units that are alike but for their values.

    **Raises:** `InputError` as that does.
    """
    units = []
    for fit in fits:
        entries = [entry for entry in fit if entry not in fit.instruments]
        at = [list(fit).index(entry) for entry in entries]
        units.append(FittedUnit(fit.model, entries, fit.error_covariance[np.ix_(at, at)]))
    return population_of_units(units)


def population_of_units(units: Sequence[FittedUnit], like: AbstractModel | None = None) -> Population:
    """The same of what other tools or files say of fits: the population of every entry that was free in all units,
    freed of the errors of the fits where all state these.

    Tables stand on the knots of `like`, by default those of the first unit, where their values and the errors of these
    are read off.

    **Raises:** `InputError` as [`fitted_population`][vgtjax.population.fitted_population] does.
    """
    units = on_common_knots(units, like)
    entries = [entry for each in units[:1] for entry in each.entries if all(entry in unit.entries for unit in units)]
    errors = [unit.errors_of(entries) for unit in units]
    stated = [each for each in errors if each is not None]
    return fitted_population([unit.model for unit in units], entries, stated if len(stated) == len(errors) else None)


def fitted_levels(population: Population) -> Population:
    """The same units with one factor a curve and nothing correlated, for indices that need independent quantities.

    A value keeps its distribution. A curve spreads as its level does, by the covariance of its entries: of a table the
    multiple of the nominal one that is nearest in the least-squares sense, of coefficients in several units the mean
    of their multiples.

    **Arguments:** `population`: of fitted units, entry by entry.
    """
    table, entries = parameter_table(population.model), population.factors.entries
    names = tuple(dict.fromkeys(entry.partition("[")[0] for entry in entries))
    margins = tuple(
        _level(population, name) if is_curve(table, name) else population.margins[entries.index(name)] for name in names
    )
    return Population(population.model, Factors(names), margins, passive=population.passive)


def _level(population: Population, name: str) -> Margin:
    """The distribution of the factor of a curve, by the deviations and the correlation of its entries."""
    row, curve = parameter_table(population.model)[name], np.asarray(get_parameter(population.model, name))
    if isinstance(row.unit, str):
        weights = curve / (curve @ curve)
    else:
        weights = np.where(curve != 0, 1 / np.where(curve != 0, curve, 1.0), 0.0) / np.count_nonzero(curve)
    weighed = dict(zip(entry_names({name: row}), weights.tolist(), strict=True))
    shares = population.deviations * [weighed.get(entry, 0.0) for entry in population.factors.entries]
    correlation = np.eye(population.dimensions) if population.correlation is None else population.correlation
    ends = domain(population.model, name)
    return _margin(1.0, np.sqrt(max(float(shares @ correlation @ shares), 0.0)), ends[0] == 0.0, ends)


def _moments(
    units: Float[np.ndarray, "units factors"], positive: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (geometric where positive), deviation (of the logarithm there), and standard scores of every unit."""
    scores = np.where(positive, np.log(np.where(positive, units, 1.0)), units)
    centre, deviation = scores.mean(axis=0), scores.std(axis=0, ddof=1)
    mean = np.where(positive, np.exp(np.where(positive, centre, 0.0)), centre)
    return mean, deviation, (scores - centre) / np.where(deviation > 0, deviation, 1.0)


def _without_errors(
    units: Float[np.ndarray, "units factors"],
    positive: np.ndarray,
    covariances: Float[np.ndarray, "units factors factors"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, deviation and correlation of what the units would be found as without errors; as `_moments` has them."""
    scores = np.where(positive, np.log(np.where(positive, units, 1.0)), units)
    slopes = np.where(positive, units, 1.0)
    # A variance of zero is a value that is known exactly.
    exact = np.einsum("uii->ui", covariances) == 0
    sizes = np.where(exact, SMALLEST * np.maximum(units**2, LEAST_SQUARE), 0.0)
    covariances = covariances + sizes[:, :, None] * np.eye(units.shape[1])
    relative = covariances / slopes[:, :, None] / slopes[:, None, :]
    precisions = np.zeros_like(relative)
    for precision, errors in zip(precisions, relative, strict=True):
        known = np.flatnonzero(np.isfinite(np.diag(errors)))
        block = np.ix_(known, known)
        # By correlation: next to logarithms, what is small in SI units would fall below the pseudo-inverse's cutoff.
        lengths = np.sqrt(np.diag(errors)[known])
        scales = np.outer(lengths, lengths)
        precision[block] = np.linalg.pinv(errors[block] / scales, hermitian=True) / scales
    centre, covariance = separate(scores, precisions)
    spread = np.diag(covariance)
    if len(units) <= len(spread):
        own = np.einsum("uii->ui", relative)
        centre, spread = separate_each(scores, np.where(np.isfinite(own), own, np.inf))
    deviation = np.sqrt(spread)
    mean = np.where(positive, np.exp(np.where(positive, centre, 0.0)), centre)
    # What no unit determines stays where the fits left it, and does not spread.
    told = np.einsum("uii->i", precisions) > 0
    mean = np.where(told, mean, _moments(units, positive)[0])
    deviation = np.where(told, deviation, 0.0)
    sizes = np.sqrt(np.diag(covariance))
    sizes = np.where(sizes > 0, sizes, 1.0)
    return mean, deviation, covariance / sizes / sizes[:, None]


def _margin(mean: float, deviation: float, positive: bool, ends: tuple[float, float]) -> Margin:
    return lognormal(mean, deviation) if positive else normal(mean, deviation, ends)
