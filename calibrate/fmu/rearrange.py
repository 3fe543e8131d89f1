"""JAX's primitives that only put numbers elsewhere: they need no C, only other places for names."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .primitives import literal

Names = np.ndarray
"""What an array is in C: an array of the same shape, of names and numbers."""


def names(texts: Any) -> Names:
    """An array of names."""
    return np.array(texts, dtype=object)


def literals(value: Any) -> Names:
    """Numbers that are known when C is written."""
    array = np.asarray(value)
    return names([literal(number) for number in array.flat]).reshape(array.shape)


def _iota(*, dtype: Any, shape: tuple[int, ...], dimension: int, **_: Any) -> Names:
    along = [1] * len(shape)
    along[dimension] = shape[dimension]
    return literals(np.broadcast_to(np.arange(shape[dimension], dtype=dtype).reshape(along), shape))


def _broadcast(given: Names, *, shape: tuple[int, ...], broadcast_dimensions: Sequence[int], **_: Any) -> Names:
    along = [1] * len(shape)
    for axis, size in zip(broadcast_dimensions, given.shape, strict=True):
        along[axis] = size
    return np.broadcast_to(given.reshape(along), shape)


def _slice(
    given: Names, *, start_indices: Sequence[int], limit_indices: Sequence[int], strides: Any, **_: Any
) -> Names:
    steps = strides or [1] * given.ndim
    return given[tuple(slice(*each) for each in zip(start_indices, limit_indices, steps, strict=True))]


def _pad(given: Names, value: Names, *, padding_config: Sequence[tuple[int, int, int]], **_: Any) -> Names:
    """Numbers around an array and between its numbers; where there are less than none, some of its own are left out."""
    for axis, (low, high, between) in enumerate(padding_config):
        shape = (*given.shape[:axis], _spread(given.shape[axis], between), *given.shape[axis + 1 :])
        spread = np.full(shape, value.item(), dtype=object)
        np.moveaxis(spread, axis, 0)[:: between + 1] = np.moveaxis(given, axis, 0)
        widths = [(0, 0)] * given.ndim
        widths[axis] = (max(low, 0), max(high, 0))
        padded = np.pad(spread, widths, constant_values=value.item())
        kept = slice(max(-low, 0), padded.shape[axis] - max(-high, 0))
        given = padded[(*[slice(None)] * axis, kept)]
    return given


def _spread(size: int, between: int) -> int:
    return size + max(size - 1, 0) * between


def _split(given: Names, *, sizes: Sequence[int], axis: int, **_: Any) -> list[Names]:
    return np.split(given, np.cumsum(sizes)[:-1], axis)


def _unstack(given: Names, *, axis: int, **_: Any) -> list[Names]:
    return [names(each) for each in np.moveaxis(given, axis, 0)]


REARRANGED: dict[str, Callable[..., Names | list[Names]]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda *given, dimension, **_: np.concatenate(given, axis=dimension),
    "expand_dims": lambda given, *, dimensions, **_: np.expand_dims(given, dimensions),
    "iota": _iota,
    "reshape": lambda given, *, new_sizes, **_: given.reshape(new_sizes),
    "pad": _pad,
    "rev": lambda given, *, dimensions, **_: np.flip(given, dimensions),
    "slice": _slice,
    "split": _split,
    "squeeze": lambda given, *, dimensions, **_: np.squeeze(given, axis=tuple(dimensions)),
    "stack": lambda *given, axis, **_: np.stack(given, axis),
    "transpose": lambda given, *, permutation, **_: np.transpose(given, permutation),
    "unstack": _unstack,
}
