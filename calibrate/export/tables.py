"""A calibrated model as a table: CSV, and a MATLAB file of version 5."""

import csv
import dataclasses
import io
import math
from typing import Any

import numpy as np
import scipy

from .results import ExportedEntry, Results

COLUMNS = tuple(field.name for field in dataclasses.fields(ExportedEntry))
TEXTS = ("name", "unit")
HEAD_BYTES = 116
"""What a MATLAB file begins with: a text that its writer chooses."""


def to_csv(results: Results, version: str, date: str) -> bytes:
    """A row for each entry; numbers in the fewest digits that read back as they are, blank where nothing is known."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in results.rows:
        writer.writerow([repr(field) if isinstance(field, float) else field for field in dataclasses.astuple(row)])
    return text.getvalue().encode()


def to_mat(results: Results, version: str, date: str) -> bytes:
    """A struct `calibration`: a column for each field of the CSV file, NaN where nothing is known, and its origin."""
    columns: dict[str, Any] = {name: _column(results, name) for name in COLUMNS}
    names = {"model": results.study.model, "components": results.study.components.names()}
    digests = {"trace": _texts(results.hashes), "sha256": _texts(results.hashes.values())}
    content = {"calibration": {"version": version, "date": date, **names, **columns, "traces": digests}}
    file = io.BytesIO()
    scipy.io.savemat(file, content, oned_as="column")
    # SciPy writes the time of day there, and the same results would never be the same file.
    head = f"MATLAB 5.0 MAT-file, vgtjax {version}, {date}".encode().ljust(HEAD_BYTES)
    return head + file.getvalue()[HEAD_BYTES:]


def _column(results: Results, name: str) -> Any:
    fields = [getattr(row, name) for row in results.rows]
    return _texts(fields) if name in TEXTS else np.array([math.nan if each is None else each for each in fields])


def _texts(texts: Any) -> np.ndarray:
    """A cell array."""
    return np.array(list(texts), dtype=object)
