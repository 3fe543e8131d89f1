"""JAX's primitives of whole arrays, each written as statements on numbers."""

import re
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from jax.lax import GatherScatterMode

from .primitives import c_type
from .rearrange import Names, names

IN_BOUNDS = (GatherScatterMode.PROMISE_IN_BOUNDS, GatherScatterMode.CLIP)


class Writer(Protocol):
    """What writes statements."""

    lines: list[str]

    def variable(self, expression: str, kind: str = "double") -> str:
        """Writes a variable, and gives its name."""

    def new(self, letter: str = "t") -> str:
        """A name that is not taken."""


def dynamic_slice(writer: Writer, given: list[Names], equation: Any) -> Names:
    """A part of an array that begins at a place known only when it runs."""
    dtype = equation.invars[0].aval.dtype
    return _part(writer, array_of(writer, given[0], c_type(dtype)), given[0].shape, given[1:], equation, dtype)


def gather(writer: Writer, given: list[Names], equation: Any) -> Names | None:
    """Parts of an array, one for each row of indices; `None` for what may reach outside of it."""
    form, (operand, indices), out = equation.params["dimension_numbers"], given, equation.outvars[0].aval
    if form.operand_batching_dims or equation.params["mode"] not in IN_BOUNDS:
        return None
    array = array_of(writer, operand, c_type(out.dtype))
    rows = indices.reshape(-1, indices.shape[-1])
    parts = []
    for row in rows:
        starts = [names("0")] * operand.ndim
        for index, axis in zip(row, form.start_index_map, strict=True):
            starts[axis] = names(index)
        part = _part(writer, array, operand.shape, starts, equation, out.dtype)
        parts.append(np.squeeze(part, axis=form.collapsed_slice_dims))
    batch = [axis for axis in range(len(out.shape)) if axis not in form.offset_dims]
    found = np.stack(parts).reshape(indices.shape[:-1] + parts[0].shape)
    return np.moveaxis(found, range(len(batch)), batch)


def scatter(writer: Writer, given: list[Names], equation: Any) -> Names | None:
    """Numbers put in, or added, at places along one axis; `None` for another kind of it."""
    form, (operand, indices, updates) = equation.params["dimension_numbers"], given
    axes, adds = form.scatter_dims_to_operand_dims, equation.primitive.name == "scatter-add"
    if len(axes) != 1 or form.inserted_window_dims != axes or form.operand_batching_dims:
        return None
    kind, found = c_type(equation.outvars[0].aval.dtype), np.moveaxis(operand, axes[0], 0).copy()
    batch = [axis for axis in range(updates.ndim) if axis not in form.update_window_dims]
    rows = np.moveaxis(updates, batch, range(len(batch))).reshape((indices.size, *found.shape[1:]))
    for row, index in enumerate(indices.flat):
        for place in np.ndindex(found.shape):
            old, new = found[place], rows[(row, *place[1:])]
            changed = f"{old} + {new}" if adds else new
            found[place] = writer.variable(f"{index} == {place[0]} ? {changed} : {old}", kind)
    return np.moveaxis(found, 0, axes[0])


def dot_general(writer: Writer, given: list[Names], equation: Any) -> Names | None:
    """Sums of products, one after the other; `None` for one with axes of a batch."""
    (left_axes, right_axes), (batch, _) = equation.params["dimension_numbers"]
    if batch:
        return None
    left = np.moveaxis(given[0], left_axes, range(-len(left_axes), 0))
    right = np.moveaxis(given[1], right_axes, range(-len(right_axes), 0))
    count = int(np.prod([given[0].shape[axis] for axis in left_axes]))
    rows, columns = left.reshape(-1, count), right.reshape(-1, count)
    found = [_dot(writer, row, column) for row in rows for column in columns]
    return names(found).reshape(equation.outvars[0].aval.shape)


def _dot(writer: Writer, row: Names, column: Names) -> str:
    total = "0.0"
    for one, other in zip(row, column, strict=True):
        total = writer.variable(f"{total} + {one} * {other}")
    return total


def _part(
    writer: Writer, array: str, shape: tuple[int, ...], starts: Sequence[Names], equation: Any, dtype: Any
) -> Names:
    sizes, strides = equation.params["slice_sizes"], [int(np.prod(shape[axis + 1 :])) for axis in range(len(shape))]
    begins = [
        writer.variable(f"vg_place({start.item()}, {length - size}) * {stride}", "int")
        for start, length, size, stride in zip(starts, shape, sizes, strides, strict=True)
    ]
    begin = " + ".join(begins)
    inside = [int(np.dot(index, strides)) for index in np.ndindex(*sizes)]
    return names([writer.variable(f"{array}[{begin} + {offset}]", c_type(dtype)) for offset in inside]).reshape(sizes)


def array_of(writer: Writer, given: Names, kind: str) -> str:
    """An array in C of these numbers: part of an argument, if that is what they are."""
    flat = [str(each) for each in given.flat]
    first = re.fullmatch(r"(\w+)\[(\d+)\]", flat[0])
    if first and flat == [f"{first[1]}[{int(first[2]) + i}]" for i in range(len(flat))]:
        return f"({first[1]} + {first[2]})"
    name = writer.new("a")
    writer.lines.append(f"const {kind} {name}[] = {{{', '.join(flat)}}};")
    return name


COMPOSED: dict[str, Callable[[Any, list[Names], Any], Names | None]] = {
    "dot_general": dot_general,
    "dynamic_slice": dynamic_slice,
    "gather": gather,
    "scatter": scatter,
    "scatter-add": scatter,
}
