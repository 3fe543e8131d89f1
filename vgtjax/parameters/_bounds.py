"""Bounds that a user sets on parameters: which entries have them, whether values keep to them, the nearest inside.

A bound is a pair `(lower, upper)` in the unit of the table; either end may be `None`.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import InputError
from .._types import Module
from ._selection import entry_names, match_entries, select
from ._table import parameter_table

Bounds = dict[str, tuple[float | None, float | None]]


def bounds_by_entry(model: eqx.Module, bounds: Bounds) -> Bounds:
    """Bounds by scalar entry from bounds by name, pattern or entry, in the order of the table.

    **Raises:** `InputError` for a name that matches nothing.
    """
    table = parameter_table(model)
    by_entry = {entry: pair for name, pair in bounds.items() for entry in match_entries(table, [name], "bounds")}
    return {entry: by_entry[entry] for entry in entry_names(table) if entry in by_entry}


def check_bounds(model: eqx.Module, bounds: Bounds) -> None:
    """Whether the values of a model, free and held, keep to bounds by entry.

    **Raises:** `InputError` for the first that does not.
    """
    selection = select(model, free=list(bounds))
    for entry, value in zip(selection.entries, selection.values(model).tolist(), strict=True):
        low, high = bounds[entry]
        if low is not None and not low <= value:
            raise InputError(f"'{entry}' must be at least {low:g}, but it is {value:g}; change one", "bounds")
        if high is not None and not value <= high:
            raise InputError(f"'{entry}' must be at most {high:g}, but it is {value:g}; change one", "bounds")


def move_inside(model: Module, bounds: Bounds) -> Module:
    """`model` moved to the nearest values inside bounds by entry; bounds of entries that it lacks don't count."""
    known = set(entry_names(parameter_table(model)))
    selection = select(model, free=[entry for entry in bounds if entry in known])
    ends = np.array([bounds[entry] for entry in selection.entries], dtype=float).reshape(-1, 2)
    low, high = np.where(np.isnan(ends), [-np.inf, np.inf], ends).T  # None reads as NaN
    return selection.unpack(model, jnp.clip(selection.pack(model), low, high))
