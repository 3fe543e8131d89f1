"""What `control` says in the terminal: the plants along each reference at each turbine pressure."""

import math
from collections.abc import Sequence
from typing import Any

import rich.table

from ..output.console import plain_table

COLUMNS = {
    "reference": ("reference", 1.0),
    "mbar": ("turbine_pressure", 1e-2),
    "RMS um": ("rms_median", 1e6),
    "worst": ("rms_worst", 1e6),
    "peak um": ("peak", 1e6),
    "Pa RMS": ("pressure_median", 1.0),
    "worst ": ("pressure_worst", 1.0),
    "effort %": ("effort", 1.0),
    "settled ms": ("settling_time", 1e3),
    "over um": ("overshoot", 1e6),
}
"""Each with what it shows of a row, and by what that is multiplied."""


def table(rows: Sequence[dict[str, Any]]) -> rich.table.Table:
    """The middle and the worst of the plants; a blank where nothing is to be said."""
    shown = plain_table(COLUMNS)
    for row in rows:
        shown.add_row(*(_cell(row[field], scale) for field, scale in COLUMNS.values()))
    return shown


def _cell(value: str | float | None, scale: float) -> str:
    if isinstance(value, str):
        return value
    return "" if value is None else "never" if value == math.inf else f"{scale * value:.4g}"
