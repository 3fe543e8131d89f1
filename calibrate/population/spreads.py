"""From the tables of a study to distributions: how each quantity of a population varies."""

import fnmatch
import itertools
import math

import numpy as np

import vgtjax
from vgtjax import InputError
from vgtjax.population import (
    Factors,
    Margin,
    Population,
    check_known,
    choose_factors,
    domain,
    lognormal,
    normal,
    triangular,
    uniform,
)

from ..study.tables import PopulationTable, Spread

NOT_VARIED = ("air.*", "*.turbine_pressure", "*.crank_angle", "*.crank.*", "diaphragm.stop_*")
"""What no tolerance is on: the weather, the knots and the geometry behind tables, and the give of rigid stops."""


def stated_population(model: vgtjax.AbstractModel, table: PopulationTable) -> Population:
    """The population that a study's tolerances describe around a nominal actuator.

    **Raises:** `InputError` for an unknown name, or a distribution that is incomplete or leaves the domain.
    """
    factors = _chosen(model, table)
    nominal = np.asarray(factors.pack(model)).tolist()
    margins = tuple(
        margin(entry, table.parameters.get(entry, Spread(relative=table.relative)), value, model, table.relative)
        for entry, value in zip(factors.entries, nominal, strict=True)
    )
    return Population(model, factors, margins, correlations(model, factors, table))


def _chosen(model: vgtjax.AbstractModel, table: PopulationTable) -> Factors:
    """What varies: what is asked for, but nothing whose value is zero and whose spread is a part of it."""
    if table.vary is None:
        known = list(vgtjax.parameter_table(model))
        fixed = [pattern for pattern in NOT_VARIED if _matches(known, pattern)]
        wanted = choose_factors(model, ["*"], [*fixed, *table.fixed]).entries
    else:
        wanted = choose_factors(model, table.vary, table.fixed).entries
    stated = choose_factors(model, list(table.parameters)).entries
    both = [name for name in stated if table.fixed and name in choose_factors(model, table.fixed).entries]
    if both:
        raise InputError(f"'{both[0]}' can't be fixed and have a spread; drop one of the two")
    check_known(model, list(table.parameters), Factors(stated), "[population.parameters]")
    factors = choose_factors(model, [*wanted, *stated])
    alive = [
        entry
        for entry in factors.entries
        if entry in stated or (not np.all(_nominal(model, entry) == 0) and np.all(np.isfinite(_nominal(model, entry))))
    ]
    if not alive:
        raise InputError("a population needs a quantity that varies, but vary and fixed leave none; vary one")
    return Factors(tuple(alive))


def _matches(names: list[str], pattern: str) -> bool:
    return any(fnmatch.fnmatchcase(name, pattern) for name in names)


def _nominal(model: vgtjax.AbstractModel, entry: str) -> np.ndarray:
    return np.asarray(vgtjax.select(model, free=[entry]).pack(model))


def margin(entry: str, spread: Spread, nominal: float, model: vgtjax.AbstractModel, relative: float) -> Margin:
    """The distribution of one quantity.

    **Raises:** `InputError` when it says too much or too little, or leaves the domain.
    """
    low, high = domain(model, entry)
    _check_stated(entry, spread)
    size = spread.deviation
    if size is None:
        size = (relative if spread.relative is None else spread.relative) * abs(nominal)
    ends = (spread.lower, spread.upper)
    match spread.distribution:
        case "normal":
            if size == 0:
                raise InputError(f"'{entry}' is 0, so its spread can't be a part of it; state its deviation")
            begin, end = (limit if given is None else given for given, limit in zip(ends, (low, high), strict=True))
            _check_ends(entry, max(begin, low), end, low)
            _check_inside(entry, nominal, begin, end)
            return normal(nominal, size, (max(begin, low), end))
        case "lognormal":
            if nominal <= 0:
                raise InputError(f"a lognormal '{entry}' must be positive, but it is {nominal:g}; choose another")
            return lognormal(nominal, math.sqrt(math.log1p((size / nominal) ** 2)))
    begin, end = (nominal + sign * size if given is None else given for given, sign in zip(ends, (-1, 1), strict=True))
    _check_ends(entry, begin, end, low)
    _check_inside(entry, nominal, begin, end)
    return uniform(begin, end) if spread.distribution == "uniform" else triangular(begin, nominal, end)


def _check_stated(entry: str, spread: Spread) -> None:
    if spread.relative is not None and spread.deviation is not None:
        raise InputError(f"the spread of '{entry}' must be either relative or a deviation, but it is both; drop one")
    if spread.distribution == "lognormal" and (spread.lower is not None or spread.upper is not None):
        raise InputError(f"a lognormal '{entry}' has no ends, but lower or upper is given; use normal, or drop them")


def _check_inside(entry: str, nominal: float, begin: float, end: float) -> None:
    if not begin <= nominal <= end:
        raise InputError(
            f"the nominal '{entry}' must lie between the ends of its distribution, but {nominal:g} is outside "
            f"{begin:g} to {end:g}; correct them, or the value under [parameters]"
        )


def _check_ends(entry: str, begin: float, end: float, low: float) -> None:
    if not begin < end or begin < low:
        raise InputError(
            f"the ends of '{entry}' must rise and not lie below {low:g}, but they are {begin:g} and {end:g}; "
            "correct them or the spread"
        )


def correlations(model: vgtjax.AbstractModel, factors: Factors, table: PopulationTable) -> np.ndarray | None:
    """The correlation of all quantities, `None` where none is stated.

    **Raises:** `InputError` for a name that does not vary.
    """
    if not table.correlation:
        return None
    matrix = np.eye(len(factors.entries))
    for stated in table.correlation:
        check_known(model, stated.parameters, factors, "[[population.correlation]]")
        places = [factors.entries.index(name) for name in stated.parameters]
        for i, j in itertools.permutations(places, 2):
            if matrix[i, j] not in (0.0, stated.value):
                names = f"'{factors.entries[min(i, j)]}' and '{factors.entries[max(i, j)]}'"
                raise InputError(f"the correlation of {names} is stated twice, and differently; drop one")
            matrix[i, j] = stated.value
    return matrix
