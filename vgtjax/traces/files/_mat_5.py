"""MAT-files of versions 5 to 7: variables one after the other, of which scipy reads those that are wanted."""

import functools
import io
import pathlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ._mat_5_check import HEADER, sound_variables
from ._mat_variables import Load, is_vector, list_objects, list_table, load_objects, variable
from ._recording import Entry, Record

NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))

Listed = tuple[str, tuple[int, ...], str]
"""Name, shape and class of a variable."""
Contents = Callable[[], dict[str, Any]]


def list_variables(path: pathlib.Path, has_objects: bool) -> Iterator[tuple[Entry, Load]]:
    """Channels of a file; structs and tables are read to be listed, vectors are not.

    **Arguments:** `has_objects`: whether there are objects of MATLAB's classes in it, which scipy doesn't read.
    """
    for (name, shape, kind), load in _list_objects(path) if has_objects else _list_plain(path):
        if kind in NUMBERS and is_vector(shape):
            yield variable(name, "", functools.partial(_read, load, name))
        elif kind == "struct":
            yield from _list_struct(name, load()[name])
        elif kind in ("table", "timetable"):
            yield from list_table(path, name)


def _list_objects(path: pathlib.Path) -> Iterator[tuple[Listed, Contents]]:
    for listed in list_objects(path):
        yield listed, functools.partial(load_objects, path, listed[0])


def _list_plain(path: pathlib.Path) -> Iterator[tuple[Listed, Contents]]:
    import scipy.io

    places = sound_variables(path)
    for listed, place in zip(scipy.io.whosmat(path), places, strict=True):
        yield listed, functools.partial(_load_plain, path, place)


def _load_plain(path: pathlib.Path, place: slice) -> dict[str, Any]:
    """One variable, as a file that has no other: scipy would look at all that stand before it."""
    import scipy.io

    with path.open("rb") as file:
        header = file.read(HEADER)
        file.seek(place.start)
        return scipy.io.loadmat(io.BytesIO(header + file.read(place.stop - place.start)))


def _read(load: Contents, name: str) -> Record:
    return Record(np.ravel(load()[name]))


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
