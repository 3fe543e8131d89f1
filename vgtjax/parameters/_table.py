"""The parameter table: name, symbol, unit, default, domain and source, declared beside each equation.

A physical parameter is an array field of an equinox module, declared with [`parameter`][]. Its name is the
path of the field, for instance ``diaphragm.stiffness``; everything that needs names, units, bounds or the
set that is held by default reads the same declaration through [`parameter_table`][].
"""

import dataclasses
import difflib
import fnmatch
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One row of the parameter table.

    `positive` says that the domain is `(0, inf)`, so that a fit moves the logarithm; `lower` is the end of the domain
    of one that is not, and may be reached. `default` is the printed value. `held` parameters are measured, or can't be
    told apart from others; a fit leaves them alone unless the study frees them by name. `assumed` marks values that
    no source states.
    """

    symbol: str
    unit: str | tuple[str, ...]
    source: str
    positive: bool = True
    held: bool = False
    assumed: bool = False
    lower: float = -math.inf
    default: float | tuple[float, ...] = 0.0
    name: str = ""
    size: int | None = None


def as_float_array(value: Any) -> Any:
    """A value as a floating array, in its own precision if it has one; a component stays what it is."""
    if isinstance(value, eqx.Module):  # a component that stands in the place of plain numbers
        return value
    if hasattr(value, "dtype") and jnp.issubdtype(value.dtype, jnp.inexact):
        return jnp.asarray(value)
    return jnp.asarray(value, dtype=float)


def parameter(
    default: float | tuple[float, ...],
    *,
    symbol: str,
    unit: str | tuple[str, ...],
    source: str,
    **row: Any,
) -> Any:
    """Declares a physical parameter as a field of an equinox module.

    **Arguments:**

    - `default`: value in `unit`; tuples of both for a vector.
    - `symbol`, `unit`, `source`: as printed in the thesis.
    - `row`: `positive`, `lower`, `held`, `assumed` of [`Parameter`][].
    """
    return eqx.field(
        default=default,
        converter=as_float_array,
        metadata={"parameter": Parameter(symbol, unit, source, default=default, **row)},
    )


def _walk(module: eqx.Module, prefix: str) -> Iterator[tuple[str, Parameter, Array]]:
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if isinstance(value, eqx.Module):
            yield from _walk(value, f"{prefix}{field.name}.")
        elif "parameter" in field.metadata:
            yield prefix + field.name, field.metadata["parameter"], value


def parameter_table(model: eqx.Module) -> dict[str, Parameter]:
    """Every parameter of `model` by name, in the order of its fields."""
    return {
        name: dataclasses.replace(row, name=name, size=None if np.ndim(value) == 0 else np.shape(value)[-1])
        for name, row, value in _walk(model, "")
    }


def get_parameter(model: eqx.Module, name: str) -> Array:
    """The value of the parameter called `name`, in the unit of the table."""
    value: Any = model
    for part in name.split("."):
        value = getattr(value, part)
    return value


def replace_parameters(model: eqx.Module, values: dict[str, Any]) -> Any:
    """A copy of `model` with the named parameters replaced; values in the units of the table, precision as it was."""
    names = list(values)
    if not names:
        return model
    return eqx.tree_at(
        lambda m: [get_parameter(m, name) for name in names],
        model,
        [as_float_array(values[name]).astype(get_parameter(model, name).dtype) for name in names],
    )


def unknown_name(kind: str, given: str, known: Iterable[str], argument: str | None = None) -> InputError:
    """The sentence for a name or pattern that matches nothing, with the nearest known one."""
    near = difflib.get_close_matches(given, list(known), n=1, cutoff=0.0)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return InputError(f"{kind} '{given}' matches nothing{hint}", argument)


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
    their physical values.
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

    def unpack(self, model: eqx.Module, vector: Float[Array, " parameters"]) -> Any:
        """`model` with its free values replaced by `vector`."""
        replaced: dict[str, Any] = {}
        for position, entry in enumerate(self.entries):
            name, index = _split(entry)
            if index is None:
                replaced[name] = vector[position]
            else:
                old = replaced.get(name, get_parameter(model, name))
                replaced[name] = old.at[index].set(vector[position])
        return replace_parameters(model, replaced)


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
