"""Tolerances around a nominal actuator: what varies from one to the next, and by which distribution."""

import dataclasses
import difflib
import fnmatch
import functools
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..parameters import parameter_table, select
from ..plants import AbstractModel
from ._factors import Factors, choose_factors
from ._population import Margin, Population, domain, lognormal, normal, triangular, uniform

NOT_VARIED = (
    *("air.*", "*.ambient_pressure", "*.turbine_pressure", "*.crank_angle", "*.crank.*", "diaphragm.stop_*"),
    *("*.nozzle.*", "*.linkage.*", "*.gas.*", "*.total_temperature", "*.outlet_pressure"),
    *("*.speed_ratio", "*.wheel_speed"),
)
"""What no tolerance is on unless it is stated: the weather, the knots and the geometry behind tables, the give of rigid
stops; and the turbine, whose sizes are assumed and whose table takes a few seconds per sample."""
DISTRIBUTIONS = ("normal", "lognormal", "uniform", "triangular")


@dataclasses.dataclass(frozen=True)
class Spread:
    """How one quantity varies from actuator to actuator, in the units of the table (a factor for a whole vector).

    `relative` is a part of the nominal value, `deviation` the same in its unit: the standard deviation of `normal` and
    `lognormal` (whose median is the nominal value), half the width of `uniform` and `triangular`. `lower` and `upper`
    are ends instead, or where a normal distribution is cut off. What is not given is that of the population.
    """

    distribution: str = "normal"
    relative: float | None = None
    deviation: float | None = None
    lower: float | None = None
    upper: float | None = None


def spread_population(
    model: AbstractModel,
    relative: float = 0.02,
    *,
    spreads: Mapping[str, Spread] | None = None,
    vary: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    correlations: Sequence[tuple[Sequence[str], float]] = (),
    passive: bool = True,
) -> Population:
    """The population that tolerances describe around a nominal actuator.

    **Arguments:**

    - `model`: the nominal actuator.
    - `relative`: standard deviation of all that has no spread of its own, as a part of the nominal value.
    - `spreads`: of single quantities, by name; these vary beside what `vary` names.
    - `vary`, `fixed`: names or patterns; by default all varies but for `NOT_VARIED`, and what is zero or infinite.
    - `correlations`: names of two quantities or more, and the correlation of the normal scores of each pair of them.
    - `passive`: whether members have friction that can't give out energy, see [`Population`][].

    **Raises:** `InputError` for an unknown name, a distribution that is incomplete or leaves the domain, or
    correlations that contradict each other.
    """
    spreads = {} if spreads is None else spreads
    _check_size("a relative spread", relative, "relative")
    factors = _chosen(model, spreads, vary, fixed)
    nominal = np.asarray(factors.pack(model)).tolist()
    margins = tuple(
        _margin(entry, spreads.get(entry, Spread()), value, relative, domain(model, entry)[0])
        for entry, value in zip(factors.entries, nominal, strict=True)
    )
    return Population(model, factors, margins, _correlation(factors, correlations), passive)


def _chosen(
    model: AbstractModel, spreads: Mapping[str, Spread], vary: Sequence[str] | None, fixed: Sequence[str]
) -> Factors:
    """What varies: what is asked for, but nothing whose value is zero and whose spread is a part of it."""
    if vary is None:
        known = parameter_table(model)
        vary, held = ["*"], [pattern for pattern in NOT_VARIED if fnmatch.filter(known, pattern)]
    else:
        held = []
    wanted = choose_factors(model, vary, [*held, *fixed]).entries
    stated = choose_factors(model, list(spreads)).entries
    both = set(stated) & set(choose_factors(model, fixed).entries)
    if both:
        raise InputError(f"'{min(both)}' can't be fixed and have a spread; drop one of the two", "fixed")
    _check_names(list(spreads), Factors(stated), "spread", "spreads")
    alive = [entry for entry in wanted if entry not in stated and _has_size(model, entry)]
    if not alive and not stated:
        raise InputError("a population needs a quantity that varies, but vary and fixed leave none; vary one", "vary")
    return choose_factors(model, [*alive, *stated])


def _has_size(model: AbstractModel, entry: str) -> bool:
    value = select(model, free=[entry]).values(model)
    return bool(np.any(value != 0) and np.all(np.isfinite(value)))


def _check_names(names: Sequence[str], factors: Factors, what: str, argument: str) -> None:
    for name in names:
        if name not in factors.entries:
            near = difflib.get_close_matches(name, factors.entries, n=1, cutoff=0.0)
            hint = f"vary it too, or did you mean '{near[0]}'?"
            raise InputError(f"'{name}' has a {what} but does not vary; {hint}", argument)


def _check_size(what: str, size: float | None, argument: str) -> None:
    if size is not None and not 0 < size < math.inf:
        raise InputError(f"{what} must be positive, but it is {size:g}; correct it", argument)


def _margin(entry: str, spread: Spread, nominal: float, relative: float, low: float) -> Margin:
    """The distribution of one quantity, whose domain begins at `low`."""
    wrong, shape = functools.partial(InputError, argument="spreads"), spread.distribution
    if spread.relative is not None and spread.deviation is not None:
        raise wrong(f"the spread of '{entry}' must be either relative or a deviation, but it is both; drop one")
    for given in (spread.relative, spread.deviation):
        _check_size(f"the spread of '{entry}'", given, "spreads")
    size = spread.deviation
    if size is None:
        size = (relative if spread.relative is None else spread.relative) * abs(nominal)
    match shape:
        case "normal":
            if size == 0:
                raise wrong(f"'{entry}' is 0, so its spread can't be a part of it; state its deviation")
            begin, end = low, math.inf
        case "lognormal":
            if spread.lower is not None or spread.upper is not None:
                raise wrong(f"a lognormal '{entry}' has no ends, but lower or upper is given; use normal, or drop them")
            if nominal <= 0:
                raise wrong(f"a lognormal '{entry}' must be positive, but it is {nominal:g}; choose another")
            return lognormal(nominal, _of_logarithm(size / nominal))
        case "uniform" | "triangular":
            begin, end = nominal - size, nominal + size
        case _:
            known = ", ".join(DISTRIBUTIONS)
            raise wrong(f"the distribution of '{entry}' must be one of {known}, but it is '{shape}'; choose one")
    begin, end = begin if spread.lower is None else spread.lower, end if spread.upper is None else spread.upper
    if shape == "normal":
        begin = max(begin, low)
    if not low <= begin < end:
        raise wrong(
            f"the ends of '{entry}' must rise and not lie below {low:g}, but they are {begin:g} and {end:g}; "
            "correct them or the spread"
        )
    if not begin <= nominal <= end:
        raise wrong(
            f"the nominal '{entry}' must lie between the ends of its distribution, but {nominal:g} is outside "
            f"{begin:g} to {end:g}; correct them, or the value"
        )
    if shape == "normal":
        return normal(nominal, size, (begin, end))
    return uniform(begin, end) if shape == "uniform" else triangular(begin, nominal, end)


def _of_logarithm(relative: float) -> float:
    """The standard deviation of a normal logarithm, by that of the value as a part of its median."""
    return math.sqrt(math.log((1 + math.sqrt(1 + 4 * relative**2)) / 2))


def _correlation(
    factors: Factors, correlations: Sequence[tuple[Sequence[str], float]]
) -> Float[np.ndarray, "factors factors"] | None:
    """The correlation of all quantities, `None` where none is stated."""
    if not correlations:
        return None
    matrix, stated = np.eye(len(factors.entries)), dict[tuple[int, int], float]()
    for names, value in correlations:
        _check_names(names, factors, "correlation", "correlations")
        for i, j in itertools.permutations([factors.entries.index(name) for name in names], 2):
            if stated.setdefault((i, j), value) != value:
                both = f"'{factors.entries[min(i, j)]}' and '{factors.entries[max(i, j)]}'"
                sentence = f"the correlation of {both} is stated twice, and differently; drop one"
                raise InputError(sentence, "correlations")
            matrix[i, j] = value
    return matrix
