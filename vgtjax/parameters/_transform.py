"""The map between physical parameters and the coordinates that an optimiser moves, and the box that holds them."""

from collections.abc import Mapping, Sequence
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._errors import InputError
from .._types import Scalar, Vector
from ._bounds import Bounds
from ._selection import table_row
from ._table import Parameter

Flags = Bool[Array | np.ndarray, " parameters"]
Scale = Literal["log", "linear"]
"""How a parameter moves in a fit: by its logarithm, or in units of its size."""
LEAST = 1e-3
"""Part of its start value that a positive parameter which moves linearly keeps at least."""
OPEN = 1e-6
"""Part of an end of a domain that may not be reached, which a search keeps from it."""


class Transform(eqx.Module):
    """Entrywise bijection between physical values and coordinates; all arrays have shape `(parameters,)`.

    `positive` entries move by their logarithm and stay so, the others move in units of `scale`; `lower` and `upper` are
    bounds of the coordinates, infinite where there is none.
    """

    positive: Bool[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)
    scale: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)
    lower: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)
    upper: Float[np.ndarray, " parameters"] = eqx.field(converter=np.asarray)

    def to_physical(self, coordinates: Vector) -> Float[Array, " parameters"]:
        """Physical values of coordinates."""
        exponent = jnp.where(self.positive, coordinates, 0.0)
        return jnp.where(self.positive, jnp.exp(exponent), self.scale * coordinates)

    def slope(self, coordinates: Vector) -> Float[Array, " parameters"]:
        """Derivative of each physical value with respect to its coordinate."""
        return jnp.where(self.positive, self.to_physical(coordinates), self.scale)

    def to_coordinates(self, values: Vector) -> Float[Array, " parameters"]:
        """Coordinates of physical values inside the domain."""
        logarithm = jnp.log(jnp.where(self.positive, values, 1.0))
        return jnp.where(self.positive, logarithm, values / self.scale)

    def extended(self, scale: float, lower: float, upper: float) -> "Transform":
        """The same with one more coordinate behind: a value of either sign in units of `scale`, and its bounds."""
        more = (False, scale, lower / scale, upper / scale)
        mine = (self.positive, self.scale, self.lower, self.upper)
        return Transform(*[np.append(values, value) for values, value in zip(mine, more, strict=True)])

    def holding(self, numbers: Sequence[int], values: Float[np.ndarray, " parameters"]) -> "Transform":
        """The same with some entries, by number, held at given values: between bounds of no width."""
        fixed = np.asarray(self.to_coordinates(values))
        lower, upper = np.array(self.lower), np.array(self.upper)
        for ends in (lower, upper):
            ends[list(numbers)] = fixed[list(numbers)]
        return Transform(self.positive, self.scale, lower, upper)

    def clip(self, coordinates: Vector) -> Vector:
        """The nearest coordinates inside the bounds."""
        return jnp.clip(coordinates, self.lower, self.upper)

    def pinned(self, coordinates: Vector, gradient: Vector) -> Flags:
        """Which coordinates lie on a bound that the cost, of this gradient, would push them through."""
        return ((coordinates <= self.lower) & (gradient > 0)) | ((coordinates >= self.upper) & (gradient < 0))

    def at_bound(self, coordinates: Vector) -> Flags:
        """Which coordinates lie on a bound."""
        return (coordinates <= self.lower) | (coordinates >= self.upper)


def build_transform(
    table: dict[str, Parameter],
    entries: Sequence[str],
    start: Vector,
    bounds: Bounds,
    scales: Mapping[str, Scale] | None = None,
) -> Transform:
    """The transform of the given entries: the table's domain and the user's bounds.

    **Arguments:** `scales`: how entries move that do not move as the table has them, positive ones by their logarithm
    and others linearly. One that is positive and moves linearly keeps a thousandth of its start value at least.

    **Raises:** `InputError` when a start value is outside its domain or its bounds, or not positive and to move by its
    logarithm.
    """
    rows = [table_row(table, entry) for entry in entries]
    usually = {entry: "log" if row.positive else "linear" for entry, row in zip(entries, rows, strict=True)}
    positive = np.array([{**usually, **(scales or {})}[entry] == "log" for entry in entries], dtype=bool)
    usual = np.abs(np.array([row.usual or row.default for row in rows], float))
    size = np.where(start != 0, np.abs(start), np.where(usual > 0, usual, 1.0))
    low, high = np.full(len(rows), -np.inf), np.full(len(rows), np.inf)
    for position, (entry, row) in enumerate(zip(entries, rows, strict=True)):
        lower, upper = bounds.get(entry, (None, None))
        domain = row.lower if row.above is None else row.above + OPEN * abs(row.above)
        low[position] = max(domain, -np.inf if lower is None else lower)
        high[position] = np.inf if upper is None else upper
        _check_start(entry, start[position], row, low[position], high[position], by_logarithm=bool(positive[position]))
        if row.positive and not positive[position]:
            low[position] = max(low[position], LEAST * start[position])
    with np.errstate(divide="ignore"):  # a lower bound of zero is no bound of a logarithm
        ends = [
            np.where(positive, np.log(np.where(positive, np.maximum(end, 0.0), 1.0)), end / size) for end in (low, high)
        ]
    return Transform(positive, size, *ends)


def _check_start(entry: str, value: Scalar, row: Parameter, lower: float, upper: float, *, by_logarithm: bool) -> None:
    if row.positive and value <= 0:
        raise InputError(
            f"the start value of '{entry}' must be positive to be fitted, but it is {value:g}; change it, or hold it "
            "with fixed",
            "values",
        )
    if by_logarithm and value <= 0:
        raise InputError(
            f"the start value of '{entry}' must be positive to be fitted by its logarithm, but it is {value:g}; change "
            "it, or its scale to linear",
            "scales",
        )
    if not np.isfinite(value):
        raise InputError(
            f"the start value of '{entry}' must be finite to be fitted, but it is {value:g}; change it, or hold it "
            "with fixed",
            "values",
        )
    if not lower <= value <= upper:
        raise InputError(
            f"the start value of '{entry}' must lie between {lower:g} and {upper:g}, but it is {value:g}; change the "
            "value or the bounds, or hold it with fixed",
            "bounds",
        )
