"""What variables of a MAT-file are to a recording, whatever the version; tables and objects by mat-io."""

import functools
import pathlib
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ._recording import Entry, Record, load_package

Load = Callable[[], Record]


def variable(name: str, group: str, load: Load, unit: str | None = None) -> tuple[Entry, Load]:
    """A vector; MATLAB gives it no unit."""
    return Entry(name, unit, group, key=(group, name), usual_unit=usual_unit(name)), load


def usual_unit(name: str) -> str | None:
    """What numbers of MATLAB are in by all custom, where nobody says it: times are in seconds."""
    return "s" if name == "time" else None


def is_vector(shape: tuple[int, ...]) -> bool:
    """Whether an array is a row, a column, or plain."""
    size = int(np.prod(shape))
    return size > 1 and max(shape) == size


def list_table(path: pathlib.Path, name: str) -> Iterator[tuple[Entry, Load]]:
    """The columns of a table or timetable, which must be read to be listed."""
    frame = load_objects(path, name)[name]
    if not hasattr(frame, "columns"):
        return  # another kind of object
    units = frame.attrs.get("varUnits") or frame.attrs.get("VariableUnits") or [""] * len(frame.columns)
    rows = np.asarray(frame.index)
    times = rows if rows.dtype.kind in "mM" else None
    for column, unit in zip(frame.columns, units, strict=True):
        values = np.asarray(frame[column])
        unit = "s" if values.dtype.kind in "mM" else unit or None  # dates and durations are converted
        entry = Entry(str(column), unit, name, times is not None, (name, column), usual_unit(str(column)))
        yield entry, functools.partial(Record, values, times)


def load_objects(path: pathlib.Path, *names: str) -> dict[str, Any]:
    """Variables of a file with objects of MATLAB's classes."""
    with warnings.catch_warnings():
        # It warns of what pandas will change, and of times rounded to nanoseconds: neither is the user's to mend.
        warnings.simplefilter("ignore")
        matio = load_package(path, "matio", "mat")
        return matio.load_from_mat(str(path), variable_names=list(names), add_table_attrs=True)


def list_objects(path: pathlib.Path) -> list[tuple[str, tuple[int, ...], str]]:
    """Name, shape and class of the variables of a file with objects."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio = load_package(path, "matio", "mat")
        return [(name, shape, kind) for name, (shape, kind) in matio.whosmat(str(path)).items()]
