"""A population of actuators: which parameters vary from one to the next, how, and together with which."""

import dataclasses
import math
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float

from .._errors import InputError
from ..parameters import parameter_table, table_row
from ..plants import AbstractModel, AbstractRodModel
from ._factors import VISCOUS, Factors, PassiveFactors, is_curve
from ._members import Members, build_members
from ._sampling import SobolSample


@runtime_checkable
class Margin(Protocol):
    """What is asked of a distribution: a frozen one of `scipy.stats` has it."""

    dist: object
    """Its family, whose class a report names."""

    def cdf(self, value: float) -> float:
        """Share of all values that are lower."""

    def ppf(self, share: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Values below which these shares of all values lie."""

    def support(self) -> tuple[float, float]:
        """The ends of what it can be."""

    def mean(self) -> float:
        """Its mean."""

    def std(self) -> float:
        """Its standard deviation."""


Rows = Float[np.ndarray, "rows factors"]


@dataclasses.dataclass(frozen=True, eq=False)
class Population:
    """Distributions of some quantities around a nominal actuator, coupled by a Gaussian copula.

    `margins` are in the order of `factors.entries` and in the units of the table. `correlation` is that of the
    normal scores, `(factors, factors)`; it may be singular, as it is where few units were measured.

    With `passive`, no member has friction that can give out energy: where the drawn viscous damping, or the nominal one
    that does not vary, is too small for that, a member has the least that is large enough.

    **Raises:** `InputError` where sizes differ, or the correlation is none.
    """

    model: AbstractModel
    factors: Factors
    margins: tuple[Margin, ...]
    correlation: Float[np.ndarray, "factors factors"] | None = None
    passive: bool = True

    def __post_init__(self) -> None:
        if len(self.margins) != len(self.factors.entries):
            raise InputError(
                f"a population needs one distribution a quantity, but it has {len(self.margins)} for "
                f"{len(self.factors.entries)}; give one each"
            )
        if self.correlation is not None:
            _check_correlation(np.asarray(self.correlation), len(self.margins))
        beside = self.passive and VISCOUS not in self.factors.entries
        kind = PassiveFactors if beside else Factors
        object.__setattr__(self, "factors", kind(self.factors.entries))

    @property
    def dimensions(self) -> int:
        """Quantities that vary."""
        return len(self.margins)

    @property
    def deviations(self) -> Float[np.ndarray, " factors"]:
        """Standard deviation of each quantity."""
        return np.array([float(margin.std()) for margin in self.margins])

    @property
    def nominal(self) -> Float[np.ndarray, " factors"]:
        """The nominal actuator's values."""
        return np.asarray(self.factors.pack(self.model))

    def values(self, points: Rows) -> Rows:
        """Parameter values of points of the open unit cube; each row by itself, so that slices give the same."""
        drawn = self._drawn(points)
        if not self.passive or VISCOUS not in self.factors.entries:
            return drawn
        raised = drawn.copy()
        # A little more than the least: rounding may not put it back outside.
        raised[:, self.factors.entries.index(VISCOUS)] += (1 + 1e-9) * np.maximum(-self._passivity(drawn), 0.0)
        return raised

    def members(self, count: int, seed: int = 0) -> Members:
        """So many actuators, at the first Sobol' points of a seed: those that can exist, and why others can't.

        **Raises:** `InputError` for a count that no sample has.
        """
        rows = self.values(SobolSample(self.dimensions, count, seed).points(0, count))
        return build_members(self.model, self.factors, rows)

    def active(self, points: Rows) -> Bool[np.ndarray, " rows"]:
        """Whether friction as drawn, before anything is raised, can give out energy."""
        return self._passivity(self._drawn(points)) < 0

    def _passivity(self, values: Rows) -> Float[np.ndarray, " rows"]:
        """Viscous damping in N s/m beyond the least of passive friction; infinite where friction is always passive."""
        if not isinstance(self.model, AbstractRodModel):
            return np.full(len(values), np.inf)
        return np.asarray(_passivity(self.model, Factors(self.factors.entries), jnp.asarray(values)))

    def _drawn(self, points: Rows) -> Rows:
        if self.correlation is not None:
            scores, factor = scipy.special.ndtri(points), _factor(np.asarray(self.correlation))
            # Term by term: a matrix product rounds differently with the number of rows.
            coupled = sum(scores[:, j : j + 1] * factor[:, j] for j in range(self.dimensions))
            points = np.clip(scipy.special.ndtr(coupled), np.finfo(float).tiny, 1 - np.finfo(float).epsneg)
        # A truncated normal misses its own end by rounding.
        return np.column_stack(
            [np.clip(margin.ppf(points[:, i]), *margin.support()) for i, margin in enumerate(self.margins)]
        )

    def independent(self) -> "Population":
        """The same distributions without their correlation, which variance-based indices need."""
        return dataclasses.replace(self, correlation=None)


@eqx.filter_jit
def _passivity(
    model: AbstractRodModel, factors: Factors, values: Float[Array, "rows factors"]
) -> Float[Array, " rows"]:
    def margin(row: Array) -> Array:
        found = factors.unpack(model, row).friction.passivity_margin()
        return jnp.asarray(jnp.inf if found is None else found)

    return jax.vmap(margin)(values)


def _check_correlation(correlation: np.ndarray, size: int) -> None:
    if correlation.shape != (size, size):
        raise InputError(f"the correlation must be {size} by {size}, but it is {correlation.shape}; give that")
    if not np.allclose(correlation, correlation.T) or not np.allclose(np.diag(correlation), 1.0):
        raise InputError("a correlation must be symmetric with ones on its diagonal, but this is not; correct it")
    lowest = float(np.linalg.eigvalsh(correlation)[0])
    if lowest < -1e-9 * size:
        raise InputError(
            f"these correlations contradict each other (smallest eigenvalue {lowest:.3g}, which must not be negative); "
            "weaken them"
        )


def _factor(correlation: np.ndarray) -> np.ndarray:
    """`L` with `L L^T = correlation`, its strongest direction first, where a low-discrepancy sequence is best."""
    values, vectors = np.linalg.eigh(correlation)
    order = np.argsort(values)[::-1]
    factor = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    return factor / np.linalg.norm(factor, axis=1, keepdims=True)


def domain(model: AbstractModel, entry: str) -> tuple[float, float]:
    """Ends of what a quantity may be, in the units of the table."""
    table = parameter_table(model)
    if is_curve(table, entry):
        return 0.0, math.inf
    row = table_row(table, entry)
    return row.lowest, math.inf


def normal(mean: float, deviation: float, ends: tuple[float, float] = (-math.inf, math.inf)) -> Margin:
    """A normal distribution, cut off at the ends of a parameter's domain where it would reach them."""
    low, high = ((end - mean) / deviation for end in ends)
    if low < -8 and high > 8:  # beyond any sample
        return scipy.stats.norm(mean, deviation)
    return scipy.stats.truncnorm(low, high, loc=mean, scale=deviation)


def lognormal(median: float, deviation: float) -> Margin:
    """A positive parameter whose logarithm is normal, with `deviation` of that logarithm."""
    return scipy.stats.lognorm(deviation, scale=median)


def uniform(lower: float, upper: float) -> Margin:
    """Every value between two ends alike."""
    return scipy.stats.uniform(lower, upper - lower)


def triangular(lower: float, mode: float, upper: float) -> Margin:
    """Most likely at `mode`, falling to nothing at the ends."""
    return scipy.stats.triang((mode - lower) / (upper - lower), loc=lower, scale=upper - lower)
