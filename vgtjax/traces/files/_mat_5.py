"""MAT-files of versions 5 to 7: variables one after the other, of which scipy reads those that are wanted."""

import functools
import pathlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ._mat import Load, is_vector, list_objects, list_table, load_objects, variable
from ._mat_5_check import require_sound
from ._recording import Entry, Record

NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def list_variables(path: pathlib.Path, has_objects: bool) -> Iterator[tuple[Entry, Load]]:
    """Channels of a file; structs and tables are read to be listed, vectors are not.

    **Arguments:** `has_objects`: whether there are objects of MATLAB's classes in it, which scipy doesn't read.
    """
    import scipy.io

    if not has_objects:
        require_sound(path)
    load = functools.partial(load_objects if has_objects else _load_plain, path)
    for name, shape, kind in list_objects(path) if has_objects else scipy.io.whosmat(path):
        if kind in NUMBERS and is_vector(shape):
            yield variable(name, "", functools.partial(_read, load, name))
        elif kind == "struct":
            yield from _list_struct(name, load(name)[name])
        elif kind in ("table", "timetable"):
            yield from list_table(path, name)


def _read(load: Callable[[str], dict[str, Any]], name: str) -> Record:
    return Record(np.ravel(load(name)[name]))


def _load_plain(path: pathlib.Path, name: str) -> dict[str, Any]:
    import scipy.io

    return scipy.io.loadmat(path, variable_names=[name])


def _list_struct(group: str, struct: np.ndarray) -> Iterator[tuple[Entry, Load]]:
    if struct.shape != (1, 1):
        return  # an array of structs has no names
    fields = struct.dtype.names or ()
    if {"X", "Y"} <= set(fields) and {"Name", "Data"} <= set(struct[0, 0]["Y"].dtype.names or ()):
        yield from _list_captured(group, struct[0, 0]["X"], struct[0, 0]["Y"])
        return
    for field in fields:
        inner = struct[0, 0][field]
        if inner.dtype.names:
            yield from _list_struct(f"{group}.{field}", inner)
        elif is_vector(inner.shape) and inner.dtype.kind in "fiub":
            yield variable(field, group, functools.partial(Record, np.ravel(inner)))


def _list_captured(group: str, axes: np.ndarray, signals: np.ndarray) -> Iterator[tuple[Entry, Load]]:
    """What dSPACE's ControlDesk captures: an array `Y` of signals with their names, and an array `X` of time axes."""
    fields = signals.dtype.names or ()
    for place, signal in enumerate(signals.ravel()):
        axis = int(np.ravel(signal["XIndex"])[0]) - 1 if "XIndex" in fields else 0
        time, values, name = np.ravel(axes.ravel()[axis]["Data"]), np.ravel(signal["Data"]), _to_text(signal["Name"])
        unit = _to_text(signal["Unit"]) if "Unit" in fields else ""
        yield Entry(name, unit or None, group, True, (group, place)), functools.partial(Record, values, time)


def _to_text(cell: np.ndarray) -> str:
    return str(np.ravel(cell)[0]) if np.size(cell) else ""
