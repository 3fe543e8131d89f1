"""A calibration as a table, in a terminal and in a notebook."""

import html
from typing import TYPE_CHECKING

import numpy as np

from ..parameters import parameter_table, table_row

if TYPE_CHECKING:
    from ._calibration import Calibration

Table = list[tuple[str, ...]]
"""Rows of cells, the header first."""


def as_text(calibration: "Calibration") -> str:
    """For a terminal."""
    return "\n".join([_headline(calibration), *(line for table in _tables(calibration) for line in _aligned(table))])


def as_html(calibration: "Calibration") -> str:
    """For a notebook."""
    tables = [
        f"<table>{''.join(_html_row(row, 'td' if place else 'th') for place, row in enumerate(table))}</table>"
        for table in _tables(calibration)
    ]
    return f"<p>{html.escape(_headline(calibration))}</p>{''.join(tables)}"


def _headline(calibration: "Calibration") -> str:
    word = "converged" if calibration.converged else "NOT converged"
    steps = calibration.progress.iteration
    return f"Calibration: {word} after {steps} step{'' if steps == 1 else 's'}; {calibration.verdict}"


def _tables(calibration: "Calibration") -> tuple[Table, Table]:
    return _estimates(calibration), _traces(calibration)


def _estimates(calibration: "Calibration") -> Table:
    rows: Table = [("parameter", "value", "std. error", "unit", "")]
    table = parameter_table(calibration.model)
    found = zip(
        calibration.task.selection.entries,
        calibration.values.tolist(),
        calibration.std_errors.tolist(),
        calibration.at_bound.tolist(),
        strict=True,
    )
    for entry, value, error, at_bound in found:
        unknown = not np.isfinite(error)
        status = "at bound" if at_bound else "not determined" if unknown else "free"
        row = table_row(table, entry)
        rows.append((entry, f"{value:.6g}", "" if unknown else f"{error:.2g}", str(row.unit), status))
    return rows


def _traces(calibration: "Calibration") -> Table:
    channels = calibration.task.channels
    units = {"x_d": "m", "p_act": "Pa"}
    rows: Table = [("trace", "use", *(f"RMSE of {channel}, {units[channel]}" for channel in channels))]
    for result in calibration.traces:
        errors = (result.rmse.get(channel) for channel in channels)
        rows.append((result.trace.name, result.use, *("" if error is None else f"{error:.3g}" for error in errors)))
    return rows


def _aligned(table: Table) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]


def _html_row(row: tuple[str, ...], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in row)}</tr>"
