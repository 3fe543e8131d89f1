"""Reading a bench trace from a text file, and saying precisely what is wrong with one.

The rules are strict on purpose: a trace that is misread calibrates an actuator to nonsense.
"""

import csv
import difflib
import functools
import io
import os
import pathlib
import re
from collections.abc import Sequence

import numpy as np

from .errors import InputError
from .trace import ASSUMED_RESERVOIR, SENSOR_PRESSURE_OFFSET, STANDARD_ATMOSPHERE, Samples, Trace

PRESSURE_UNITS = ("Pa", "kPa", "mbar", "bar")
UNITS: dict[str, tuple[str, ...]] = {
    "time": ("s", "ms"),
    "pwm": ("%", "1"),
    "p_act": PRESSURE_UNITS,
    "p_res": PRESSURE_UNITS,
    "p_trb": PRESSURE_UNITS,
    "x_d": ("m", "mm", "um"),
    "f_vane": ("N",),
    "f_drive": ("N",),
}
"""The units that each column may have; pressures are followed by `gauge` or `absolute`."""
SI = {"time": "s", "pwm": "percent", "p_act": "Pa", "p_res": "Pa", "p_trb": "Pa", "x_d": "m"}
SIMULATED_ONLY = {"x_p", "v_p", "v_d", "z", "T_act", "m_dot_in", "m_dot_out"}
"""Columns that a simulation writes and that are no input: ignored, not misspelt."""
POSITION_RANGE = (-0.5e-3, 30e-3)
"""m; 0.5 mm outside the open stop is a sensor offset, and no actuator of this type travels 30 mm."""
GAP = 5.0
"""A step over this many median steps is a gap."""


def load_trace(
    path: str | os.PathLike[str],
    *,
    atmosphere: float = STANDARD_ATMOSPHERE,
    needs: Sequence[str] = (),
    name: str | None = None,
) -> Trace:
    """Reads a bench trace (CSV with `name [unit]` headers; semicolons, tabs and a byte-order mark are read too).

    **Arguments:**

    - `atmosphere`: Pa; added to gauge pressures.
    - `needs`: columns that must be present, alternatives joined by `|`.
    - `name`: of the trace; the file's stem by default.

    **Returns:** a [`Trace`][] in SI units; its `notes` say what was assumed or ignored.

    **Raises:** `InputError` with file, line (the header is 1), column and remedy.
    """
    path = pathlib.Path(path)
    header, rows = _split_rows(path, _read_text(path))
    columns = _Columns(path, header)
    for need in ("time", *needs):
        columns.require(need)
    table = _numbers(path, columns, rows)
    _check_time(path, table["time"])
    signals: dict[str, Samples] = {}
    for column, values in table.items():
        signals[column] = columns.to_si(column, values, atmosphere)
        _check_range(path, column, values, signals[column], columns)
    notes = list(columns.notes)
    if "p_res" not in signals and "f_drive" not in signals:
        notes.append(f"no column p_res; {ASSUMED_RESERVOIR:.0f} Pa absolute is assumed for the reservoir")
    return Trace(
        **signals, atmosphere=atmosphere, name=path.stem if name is None else name, notes=tuple(notes)
    )


def _fail(path: pathlib.Path, what: str, remedy: str, line: int | None = None, column: str | None = None):
    place = path.name
    if line is not None:
        place += f", line {line}"
    if column is not None:
        place += f", column {column}"
    return InputError(f"{place}: {what}; {remedy}")


def _read_text(path: pathlib.Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise _fail(path, f"can't be read ({error.strerror})", "check the path of the file") from error
    if not raw.strip():
        raise _fail(path, "the file is empty", "export the trace again")
    if b"\0" in raw and not raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise _fail(path, "this is a binary file, not text", "export the trace as CSV")
    encoding = "utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        raise _fail(path, "this is not UTF-8 text", "export the trace as CSV in UTF-8", line=1) from error


def _split_rows(path: pathlib.Path, text: str) -> tuple[list[str], list[list[str]]]:
    first = text.split("\n", 1)[0]
    delimiter = ";" if ";" in first else "\t" if "\t" in first else ","
    rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    while rows and not rows[-1]:
        rows.pop()
    header = [cell.strip() for cell in rows[0]]
    if len(rows) < 3:
        raise _fail(path, f"a trace needs at least two samples, but it has {len(rows) - 1}", "export it again")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            found = "a blank line" if not row else f"{len(row)} cells"
            raise _fail(
                path, f"the row must have {len(header)} cells, but it has {found}", "repair the row", number
            )
    body = rows[1:]
    if delimiter != ",":
        body = [[cell.replace(",", ".") for cell in row] for row in body]
    return header, body


class _Columns:
    """The header: which column stands where, in which unit."""

    def __init__(self, path: pathlib.Path, header: Sequence[str]):
        self.path = path
        self.position: dict[str, int] = {}
        self.unit: dict[str, str] = {}
        self.reference: dict[str, str] = {}
        self.notes: list[str] = []
        for position, cell in enumerate(header):
            match = re.fullmatch(r"([^\[\]]*?)\s*(?:\[(.*)\])?", cell)
            if match is None:
                raise self._fail(
                    f"the header '{cell}' must read 'name [unit]'", "write e.g. 'x_d [mm]'", cell
                )
            self._add(position, match[1].strip(), match[2])

    def _fail(self, what: str, remedy: str, column: str) -> InputError:
        return _fail(self.path, what, remedy, 1, column)

    def _add(self, position: int, name: str, unit: str | None) -> None:
        if name not in UNITS:
            self._ignore(name)
            return
        if name in self.position:
            raise self._fail("the column appears twice", "remove or rename one of them", name)
        if unit is None or not unit.strip():
            raise self._fail(
                "the unit is missing", f"write e.g. '{name} [{_example_unit(name)}]' in the header", name
            )
        words = unit.split()
        pressure = name.startswith("p_")
        if words[0] not in UNITS[name] or (len(words) > 1 and not pressure) or len(words) > 2:
            raise self._fail(
                f"the unit '{unit}' is not known here", f"use one of {', '.join(UNITS[name])}", name
            )
        if pressure and (len(words) != 2 or words[1] not in ("gauge", "absolute")):
            raise self._fail(
                f"a pressure must be gauge or absolute, but its unit is '{unit}'",
                f"write '{name} [{words[0]} gauge]' or '{name} [{words[0]} absolute]'",
                name,
            )
        self.position[name] = position
        self.unit[name] = words[0]
        self.reference[name] = words[1] if pressure else ""

    def _ignore(self, name: str) -> None:
        near = [known for known in UNITS if _distance_at_most(name, known, 2)]
        if near and name not in SIMULATED_ONLY:
            best = difflib.get_close_matches(name, near, n=1, cutoff=0.0)[0]
            raise self._fail(
                f"the name '{name}' looks like a misspelt '{best}'",
                f"write '{best}', or rename the column if it is something else",
                name,
            )
        self.notes.append(f"column '{name}' is not used")

    def require(self, need: str) -> None:
        alternatives = need.split("|")
        if not any(column in self.position for column in alternatives):
            wanted = " or ".join(f"'{column} [{_example_unit(column)}]'" for column in alternatives)
            raise self._fail("the column is missing", f"add a column {wanted}", " or ".join(alternatives))

    def to_si(self, name: str, values: Samples, atmosphere: float) -> Samples:
        """Values in SI; pressures absolute, but that of the turbine gauge."""
        factor = 100.0 if (name, self.unit[name]) == ("pwm", "1") else _factor(self.unit[name], SI.get(name))
        converted = values * factor
        reference = self.reference[name]
        if name == "p_trb":
            return converted - atmosphere if reference == "absolute" else converted
        return converted + atmosphere if reference == "gauge" else converted


def _example_unit(name: str) -> str:
    unit = {"time": "s", "x_d": "mm", "pwm": "%"}.get(name, UNITS[name][0])
    return f"{unit} gauge" if name.startswith("p_") else unit


@functools.cache
def _factor(unit: str, target: str | None) -> float:
    """Factor from a unit to its SI unit; pint knows, and is only loaded when it is asked."""
    if target is None or unit in (target, "%"):
        return 1.0
    import pint

    return float(pint.get_application_registry().Quantity(1.0, unit).to(target).magnitude)


def _distance_at_most(a: str, b: str, limit: int) -> bool:
    """Whether at most `limit` letters must be inserted, deleted or replaced (Levenshtein)."""
    row = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        previous, row[0] = row[0], i
        for j, other in enumerate(b, 1):
            previous, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, previous + (letter != other))
    return 0 < row[-1] <= limit


def _numbers(path: pathlib.Path, columns: _Columns, rows: list[list[str]]) -> dict[str, Samples]:
    table = {}
    for name, position in columns.position.items():
        cells = [row[position] for row in rows]
        try:
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            raise _bad_cell(path, name, cells) from None
        if not np.all(np.isfinite(values)):
            raise _bad_cell(path, name, cells)
        table[name] = values
    return table


def _bad_cell(path: pathlib.Path, name: str, cells: list[str]) -> InputError:
    for line, cell in enumerate(cells, 2):
        if not cell.strip():
            return _fail(path, "the cell is blank", "fill it in or remove the row", line, name)
        try:
            value = float(cell)
        except ValueError:
            return _fail(path, f"'{cell}' is not a number", "repair the cell", line, name)
        if not np.isfinite(value):
            return _fail(path, f"'{cell}' is not a finite number", "remove the row or repair it", line, name)
    raise AssertionError("called for cells that are all finite numbers")


def _check_time(path: pathlib.Path, time: Samples) -> None:
    steps = np.diff(time)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        what = "stands still" if steps[row - 1] == 0 else "runs back"
        raise _fail(
            path,
            f"time must increase from row to row, but it {what} ({time[row - 1]:g} to {time[row]:g})",
            "remove the repeated or misplaced rows",
            row + 2,
            "time",
        )
    gaps = steps > GAP * np.median(steps)
    if np.any(gaps):
        row = int(np.argmax(gaps)) + 1
        raise _fail(
            path,
            f"time has a gap of {steps[row - 1]:g} where the median step is {np.median(steps):g}",
            "split the trace there, or record it without loss",
            row + 2,
            "time",
        )


def _check_range(
    path: pathlib.Path, name: str, raw: Samples, values: Samples, columns: _Columns
) -> None:
    """What sensor and physics allow; sensors have offsets."""
    ranges = {
        "pwm": (0.0, 100.0),
        "p_act": (-SENSOR_PRESSURE_OFFSET, 1.5e5),
        "p_res": (-SENSOR_PRESSURE_OFFSET, 1.5e5),
        "p_trb": (-STANDARD_ATMOSPHERE - SENSOR_PRESSURE_OFFSET, 2e6),
    }
    if "f_drive" not in columns.position:
        ranges["x_d"] = POSITION_RANGE
    if name not in ranges:
        return
    low, high = ranges[name]
    outside = (values < low) | (values > high)
    if np.any(outside):
        row = int(np.argmax(outside))
        unit = f"{columns.unit[name]} {columns.reference[name]}".strip()
        si = {"pwm": "%", "x_d": "m", "p_trb": "Pa gauge"}.get(name, "Pa absolute")
        raise _fail(
            path,
            f"{raw[row]:g} {unit} is outside what sensor and physics allow ({low:g} to {high:g} {si})",
            "check the sensor, its unit, and gauge against absolute",
            row + 2,
            name,
        )
