"""MAT-files of MATLAB: versions 5 to 7 by scipy, 7.3 (HDF5) by h5py, tables and timetables in both by mat-io.

Whatever the version, a file is variables: a vector is a channel, and a struct or a table is a group of channels.
"""

import contextlib
import functools
import pathlib
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ._recording import Entry, Record, Recording, load_package, read_start, reading, require_start

HDF5 = b"\x89HDF"
VERSION_5 = (b"\x00\x01", b"\x01\x00")
"""Where a header has its version, in either order of bytes; 7.3 has a 2, and its text may say anything."""
Load = Callable[[], Record]


class MATRecording(Recording):
    """Variables of a MAT-file; those of structs by the dotted path to them, whatever is no vector left out."""

    def __init__(self, path: pathlib.Path):
        self.path = path
        require_start(path, (b"MATLAB ", HDF5), "MATLAB")
        start = read_start(path, 128)
        with contextlib.ExitStack() as stack, reading(path, "MATLAB"):
            if start[124:126] in VERSION_5:
                from ._mat_5 import list_variables

                found = list_variables(path, has_objects=bool(start[116:124].strip(b" \0")))
            else:
                from ._mat_hdf import list_datasets

                h5py = load_package(path, "h5py", "mat")
                found = list_datasets(path, stack.enter_context(h5py.File(path, "r")))
            self._loads: dict[Entry, Load] = dict(found)
            self.entries = list(self._loads)
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()

    def read(self, entry: Entry) -> Record:
        """The numbers of a vector, and the times of a row of a timetable."""
        with reading(self.path, "MATLAB"):
            return self._loads[entry]()


def variable(name: str, group: str, load: Load, unit: str | None = None) -> tuple[Entry, Load]:
    """A vector; MATLAB gives it no unit, and `time` is in seconds by all custom."""
    return Entry(name, "s" if name == "time" and unit is None else unit, group, key=(group, name)), load


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
        unit = "s" if column == "time" or values.dtype.kind in "mM" else unit or None
        entry = Entry(str(column), unit, name, times is not None, key=(name, column))
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
