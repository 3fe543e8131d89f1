"""Scalar entries of a model's parameters by name or pattern, and which of them are free."""

import dataclasses
import fnmatch
import re
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._types import Module, Vector
from ._table import Parameter, get_parameter, parameter_table, replace_parameters, unknown_name


def entry_names(table: dict[str, Parameter]) -> list[str]:
    """Scalar entries: a vector contributes one entry a component, `name[0]`, `name[1]`, and so on."""
    names: list[str] = []
    for name, row in table.items():
        names += [name] if row.size is None else [f"{name}[{i}]" for i in range(row.size)]
    return names


def _split(entry: str) -> tuple[str, int | None]:
    match = re.fullmatch(r"(.*)\[(\d+)\]", entry)
    return (match[1], int(match[2])) if match else (entry, None)


def match_entries(table: dict[str, Parameter], patterns: Sequence[str], argument: str | None = None) -> set[str]:
    """Entries that any of the names or fnmatch patterns addresses.

    A vector's name addresses all its entries, `name[2]` one of them. `argument` is what the caller calls `patterns`.

    **Raises:** `InputError` for a pattern that matches nothing, with the nearest name.
    """
    entries = entry_names(table)
    found: set[str] = set()
    for pattern in patterns:
        base, index = _split(pattern)
        hits = {
            entry
            for entry in entries
            if fnmatch.fnmatchcase(_split(entry)[0], base) and index in (None, _split(entry)[1])
        }
        if not hits:
            raise unknown_name("parameter name or pattern", pattern, [*table, *entries], argument)
        found |= hits
    return found


class Selection(eqx.Module):
    """Which scalar entries of a model's parameters are free, in the order of the table.

    `entries` are the names of the free entries; `pack` and `unpack` go between a model and the vector of
    their physical values, `values` has that on the host.
    """

    entries: tuple[str, ...] = eqx.field(static=True)

    def pack(self, model: eqx.Module) -> Float[Array, " parameters"]:
        """Free values of `model` as one vector, in the units of the table."""
        values = []
        for entry in self.entries:
            name, index = _split(entry)
            value = get_parameter(model, name)
            values.append(value if index is None else value[index])
        return jnp.stack(values) if values else jnp.zeros(0)

    def values(self, model: eqx.Module) -> Float[np.ndarray, " parameters"]:
        """The same on the host, of a model whose values are known: no program of JAX is asked."""
        found: dict[str, np.ndarray] = {}
        values = []
        for entry in self.entries:
            name, index = _split(entry)
            if name not in found:
                found[name] = np.asarray(get_parameter(model, name))
            values.append(found[name][() if index is None else index])
        return np.array(values) if values else np.zeros(0)

    def unpack(self, model: Module, vector: Vector) -> Module:
        """`model` with its free values replaced by `vector`."""
        # Once for every parameter, not for every entry: outside of a compiled function each is a program of its own.
        places: dict[str, list[tuple[int | None, int]]] = {}
        for position, entry in enumerate(self.entries):
            name, index = _split(entry)
            places.setdefault(name, []).append((index, position))
        replaced: dict[str, Any] = {}
        for name, each in places.items():
            indices, positions = zip(*each, strict=True)
            if indices == (None,):
                replaced[name] = vector[positions[0]]
            else:
                entries = np.array(indices), vector[np.array(positions)]
                replaced[name] = _with_entries(get_parameter(model, name), *entries)
        return replace_parameters(model, replaced)


def _with_entries(
    whole: Float[Array | np.ndarray, " size"],
    places: Int[np.ndarray, " entries"],
    values: Float[Array | np.ndarray, " entries"],
) -> Float[Array | np.ndarray, " size"]:
    """A vector with other values at some places; of numbers on the host without a program for it."""
    if isinstance(values, np.ndarray) and not isinstance(whole, jax.core.Tracer):
        changed = np.array(whole)
        changed[places] = values
        return changed
    return jnp.asarray(whole).at[places].set(values)


def select(model: eqx.Module, free: Sequence[str] | None = None, fixed: Sequence[str] = ()) -> Selection:
    """The free entries of a model.

    **Arguments:**

    - `free`: names or fnmatch patterns; `None` frees all that the table does not hold.
    - `fixed`: names or patterns that stay; beats `free`.

    **Raises:** `InputError` for a name or pattern that matches nothing.
    """
    table = parameter_table(model)
    if free is None:
        chosen = {entry for entry in entry_names(table) if not table[_split(entry)[0]].held}
    else:
        chosen = match_entries(table, free, "free")
    chosen -= match_entries(table, fixed, "fixed")
    return Selection(tuple(entry for entry in entry_names(table) if entry in chosen))


def table_row(table: dict[str, Parameter], entry: str) -> Parameter:
    """The row of an entry such as `converter.magnetic_force[2]`, with that entry's unit."""
    name, index = _split(entry)
    row = table[name]
    if index is None:
        return row
    unit = row.unit if isinstance(row.unit, str) else row.unit[index]
    # A table may have more entries than the one that is printed.
    default = row.default[index] if isinstance(row.default, tuple) and index < len(row.default) else 0.0
    return dataclasses.replace(row, symbol=f"{row.symbol}{index}", unit=unit, default=default, name=entry, size=None)
