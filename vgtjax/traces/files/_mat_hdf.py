"""MAT-files of version 7.3, which are HDF5: every dataset can be read by itself."""

import functools
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from ._mat_variables import Load, is_vector, list_table, variable
from ._recording import Entry, Record


def list_datasets(path: pathlib.Path, node: Any, group: str = "") -> Iterator[tuple[Entry, Load]]:
    """Channels below a group of HDF5, which is a struct of MATLAB, or the file itself."""
    for name, item in node.items():
        kind = item.attrs.get("MATLAB_class", b"")
        if name.startswith("#"):
            continue  # where MATLAB keeps what others refer to
        if kind in (b"table", b"timetable"):
            yield from list_table(path, name)
        elif hasattr(item, "items"):
            yield from list_datasets(path, item, f"{group}.{name}" if group else name)
        elif item.dtype.kind in "fiub" and kind != b"char" and is_vector(item.shape):
            # MATLAB writes no unit, other programs do.
            yield variable(name, group, functools.partial(_read, item), _text(item.attrs.get("unit")))


def _text(attribute: Any) -> str | None:
    """Text of any length, fixed or not, alone or in an array of one."""
    values = np.ravel(attribute).tolist()
    if attribute is None or len(values) != 1:
        return None
    return values[0].decode("utf-8", "replace") if isinstance(values[0], bytes) else str(values[0])


def _read(dataset: Any) -> Record:
    return Record(np.ravel(dataset[()]))
