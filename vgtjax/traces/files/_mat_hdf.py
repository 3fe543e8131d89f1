"""MAT-files of version 7.3, which are HDF5: every dataset can be read by itself."""

import functools
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from ._mat import Load, is_vector, list_table, variable
from ._recording import Entry, Record


def list_datasets(path: pathlib.Path, node: Any, group: str = "") -> Iterator[tuple[Entry, Load]]:
    """Channels below a group of HDF5, which is a struct of MATLAB, or the file itself."""
    for name, item in node.items():
        kind = item.attrs.get("MATLAB_class", b"")
        inner = f"{group}.{name}" if group else name
        if name.startswith("#"):
            continue  # where MATLAB keeps what others refer to
        if kind in (b"table", b"timetable"):
            yield from list_table(path, inner)
        elif hasattr(item, "items"):
            yield from list_datasets(path, item, inner)
        elif (
            item.dtype.kind in "fiub"
            and kind != b"char"
            and is_vector(item.shape)
            and not item.attrs.get("MATLAB_empty")
        ):
            yield variable(name, group, functools.partial(_read, item))


def _read(dataset: Any) -> Record:
    return Record(np.ravel(dataset[()]))
