"""The population behind fitted units: mean, spread and correlation of their parameters."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..parameters import Selection, get_parameter, parameter_table
from ..plants import AbstractModel
from ._factors import Factors, is_curve
from ._population import Margin, Population, domain, lognormal, normal

SMALLEST = 1e-12
"""Relative spread below which a quantity is the same in all units."""


def fitted_population(models: Sequence[AbstractModel], entries: Sequence[str]) -> Population:
    """The population that fitted units are a sample of.

    Positive quantities are lognormal, others normal, around the units' mean (geometric for positive ones). Spread and
    correlation are those of the units, with the errors of the fits in them.

    **Arguments:** `models`: the units, alike but for their values; `entries`: what was fitted, entry by entry.

    **Raises:** `InputError` for fewer than three units.
    """
    if len(models) < 3:
        raise InputError(f"a population needs three fitted units or more, but there are {len(models)}; fit more")
    selection = Selection(tuple(entries))
    units = np.stack([np.asarray(selection.pack(model)) for model in models])
    ends = [domain(models[0], entry) for entry in entries]
    positive = np.array([low == 0.0 for low, _ in ends]) & np.all(units > 0, axis=0)
    mean, deviation, scores = _moments(units, positive)
    chosen = np.flatnonzero(deviation > SMALLEST * np.where(positive, 1.0, np.abs(mean))).tolist()
    correlation = scores[:, chosen].T @ scores[:, chosen] / (len(units) - 1)
    np.fill_diagonal(correlation, 1.0)
    return Population(
        selection.unpack(models[0], jnp.asarray(mean)),
        Factors(tuple(entries[i] for i in chosen)),
        tuple(_margin(mean[i], deviation[i], bool(positive[i]), ends[i]) for i in chosen),
        correlation,
    )


def fitted_levels(population: Population, models: Sequence[AbstractModel]) -> Population:
    """The same units with one factor a curve and nothing correlated, for indices that need independent quantities.

    A unit's factor is the multiple of the nominal curve that is nearest to its own in the least-squares sense.
    """
    table = parameter_table(population.model)
    names = tuple(dict.fromkeys(entry.partition("[")[0] for entry in population.factors.entries))
    units = np.stack([[_level(population.model, model, name, table) for name in names] for model in models])
    ends = [domain(population.model, name) for name in names]
    positive = np.array([low == 0.0 for low, _ in ends]) & np.all(units > 0, axis=0)
    _, deviation, _ = _moments(units, positive)
    factors = Factors(names)
    nominal = np.asarray(factors.pack(population.model))
    margins = tuple(
        _margin(value, spread, bool(log), end)
        for value, spread, log, end in zip(nominal, deviation, positive, ends, strict=True)
    )
    return Population(population.model, factors, margins, passive=population.passive)


def _level(nominal: AbstractModel, model: AbstractModel, name: str, table: dict) -> float:
    value = np.asarray(get_parameter(model, name))
    if not is_curve(table, name):
        return float(value)
    curve = np.asarray(get_parameter(nominal, name))
    return float(curve @ value / (curve @ curve))


def _moments(
    units: Float[np.ndarray, "units factors"], positive: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (geometric where positive), deviation (of the logarithm there), and standard scores of every unit."""
    scores = np.where(positive, np.log(np.where(positive, units, 1.0)), units)
    centre, deviation = scores.mean(axis=0), scores.std(axis=0, ddof=1)
    mean = np.where(positive, np.exp(np.where(positive, centre, 0.0)), centre)
    return mean, deviation, (scores - centre) / np.where(deviation > 0, deviation, 1.0)


def _margin(mean: float, deviation: float, positive: bool, ends: tuple[float, float]) -> Margin:
    return lognormal(mean, deviation) if positive else normal(mean, deviation, ends)
