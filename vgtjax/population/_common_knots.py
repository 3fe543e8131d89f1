"""Fitted units whose tables stand on knots of their own, on those of the first."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..parameters import Selection, entry_names, get_parameter, parameter_table
from ..plants import AbstractModel, Moves, on_knots, other_knots


@dataclasses.dataclass(frozen=True, eq=False)
class FittedUnit:
    """What a fit found of one unit: the model, the entries that were free, and the covariance of their errors in the
    units of the table, NaN for what the traces did not determine, `None` where it is not stated."""

    model: AbstractModel
    entries: Sequence[str]
    covariance: Float[np.ndarray, "entries entries"] | None

    def errors_of(self, entries: Sequence[str]) -> Float[np.ndarray, "part part"] | None:
        """The covariance of some of the entries."""
        at = [list(self.entries).index(entry) for entry in entries]
        return None if self.covariance is None else self.covariance[np.ix_(at, at)]


def on_common_knots(units: Sequence[FittedUnit], like: AbstractModel | None = None) -> list[FittedUnit]:
    """Units with their tables, and the errors of these, read at the knots of one model, by default of the first unit's.

    A table of which not all entries were free is none that was fitted then, and knots were not.
    """
    if not units:
        return []
    like = units[0].model if like is None else like
    knots = {name: get_parameter(like, name) for name in parameter_table(like)}
    return [_moved(unit, knots) for unit in units]


def _moved(unit: FittedUnit, knots: dict[str, Array]) -> FittedUnit:
    moves = other_knots(unit.model, knots)
    if not moves:
        return unit
    moved = on_knots(unit.model, moves)
    own, table = parameter_table(unit.model), parameter_table(moved)
    read_along = {axis for row in own.values() for axis in row.axes}
    free = [entry for entry in unit.entries if entry.partition("[")[0] not in read_along]
    whole = [name for name in own if set(entry_names({name: own[name]})) <= set(free)]
    entries = [
        entry
        for name, row in table.items()
        for entry in entry_names({name: row})
        if name in whole or (entry in free and not row.axes)
    ]
    before, after = Selection(tuple(free)), Selection(tuple(entries))
    errors = unit.errors_of(free)
    if errors is None:
        return FittedUnit(moved, entries, None)

    slopes = np.asarray(_slopes(unit.model, before, after, moves))
    lost = (slopes != 0) @ np.isnan(np.diag(errors))
    covariance = slopes @ np.where(np.isnan(errors), 0.0, errors) @ slopes.T
    covariance[lost], covariance[:, lost] = np.nan, np.nan
    return FittedUnit(moved, entries, covariance)


@eqx.filter_jit
def _slopes(model: AbstractModel, before: Selection, after: Selection, moves: Moves) -> Float[Array, "entries own"]:
    """How entries at other knots move with those of a model; compiled once for all units of a fleet."""

    def read(values: Float[Array, " own"]) -> Float[Array, " entries"]:
        return after.pack(on_knots(before.unpack(model, values), moves))

    return jax.jacfwd(read)(before.pack(model))
