"""Parquet, the tables of data analysis; read by pyarrow."""

import contextlib
import pathlib
from typing import Any

import numpy as np

from ._recording import Entry, Record, Recording, load_package, reading, require_start


class ParquetRecording(Recording):
    """A table with a column of times; where a column has a null, it was not sampled at that time."""

    noun = "column"
    item = "row"

    def __init__(self, path: pathlib.Path):
        self.path = path
        require_start(path, (b"PAR1",), "Parquet")
        parquet = load_package(path, "pyarrow.parquet", "parquet")
        with contextlib.ExitStack() as stack:
            with reading(path, "Parquet"):
                self._file: Any = stack.enter_context(parquet.ParquetFile(path))
                self.entries = [_entry(field) for field in self._file.schema_arrow]
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()

    def read(self, entry: Entry) -> Record:
        """The numbers of a column, and their rows where others have none."""
        with reading(self.path, "Parquet"):
            column = self._file.read(columns=[entry.name])[entry.name]
            values = np.asarray(column.drop_null().to_numpy())
            there = ~np.asarray(column.is_null().to_numpy())
        return Record(values, rows=None if np.all(there) else np.flatnonzero(there))


def _entry(field: Any) -> Entry:
    """A column; its unit may stand in the metadata of its field."""
    unit = (field.metadata or {}).get(b"unit", b"").decode() or None
    is_date = str(field.type).startswith(("timestamp", "duration"))
    return Entry(field.name, "s" if is_date else unit)
