"""Reading a bench trace from a text file, and saying precisely what is wrong with one.

The rules are strict on purpose: a trace that is misread calibrates an actuator to nonsense.
"""

import csv
import difflib
import functools
import io
import math
import os
import pathlib
import re
from collections.abc import Sequence

import numpy as np

from .._errors import InputError
from ._channel import Samples
from ._signals import SIGNALS
from ._trace import ASSUMED_RESERVOIR, SENSOR_PRESSURE_OFFSET, STANDARD_ATMOSPHERE, Trace

PRESSURES = ("p_act", "p_res", "p_trb")
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
SIMULATED_ONLY = {name for name, signal in SIGNALS.items() if signal.role == "state"}
"""Columns that a simulation writes and that are no input: ignored, not misspelt."""
TRAVEL = 10.13e-3
"""m; the printed `diaphragm.travel`, for a caller who knows no better."""
SENSOR_POSITION_OFFSET = 0.5e-3
"""m; position sensors are trusted to within half a millimetre."""
HIGHEST_BOOST = 2e6
"""Pa gauge; no turbine inlet sees 20 bar."""
GAP = 5.0
"""A step over this many median steps is a gap."""


def load_trace(
    path: str | os.PathLike[str],
    *,
    atmosphere: float = STANDARD_ATMOSPHERE,
    travel: float = TRAVEL,
    needs: Sequence[str] = (),
    ignore: Sequence[str] = (),
    name: str | None = None,
) -> Trace:
    """Reads a bench trace (CSV with `name [unit]` headers; semicolons, tabs, a byte-order mark too).

    **Arguments:**

    - `atmosphere`: Pa; added to gauge pressures.
    - `travel`: m; a position beyond it, or a pressure outside vacuum and atmosphere, is refused unless it is
      within what sensors are off by. With a measured `f_drive` any position goes.
    - `needs`: columns that must be present, alternatives joined by `|`.
    - `ignore`: columns that the model at hand has no use for.
    - `name`: of the trace; the file's stem by default.

    **Returns:** a [`Trace`][] in SI units; its `notes` say what was assumed or ignored.

    **Raises:** `InputError` with file, line (the header is 1), column and remedy.
    """
    path = pathlib.Path(path)
    header, rows, decimal = _split_rows(path, _read_text(path))
    columns = _Columns(path, header, ignore)
    for need in ("time", *needs):
        columns.require(need)
    table = _numbers(path, columns, rows, decimal)
    _check_time(path, table["time"])
    ends = _ends(atmosphere, travel)
    if "f_drive" in table:
        del ends["x_d"]  # a rig that is driven by a force need not be this actuator
    signals: dict[str, Samples] = {}
    for column, values in table.items():
        signals[column] = columns.to_si(column, values, atmosphere)
        if column in ends:
            _check_range(columns, column, values, signals[column], ends[column])
    notes = list(columns.notes)
    if "p_res" not in signals and "f_drive" not in signals:
        notes.append(f"no column p_res; {ASSUMED_RESERVOIR:.0f} Pa absolute is assumed for the reservoir")
    return Trace(**signals, atmosphere=atmosphere, name=path.stem if name is None else name, notes=tuple(notes))


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
    wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in raw and not wide:
        raise _fail(path, "this is a binary file, not text", "export the trace as CSV", 1)
    try:
        text = raw.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise _fail(path, "this is not UTF-8 text", "export the trace as CSV in UTF-8", line) from error
    if not text.strip():
        raise _fail(path, "the file is empty", "export the trace again", 1)
    return text


def _split_rows(path: pathlib.Path, text: str) -> tuple[list[str], list[list[str]], str]:
    """The header, the rows below it, and the decimal sign that goes with the delimiter."""
    first = text.split("\n", 1)[0]
    delimiter = ";" if ";" in first else "\t" if "\t" in first else ","
    lines = io.StringIO(text, newline="")
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    rows: list[list[str]] = []
    try:
        for row in reader:
            if reader.line_num > len(rows) + 1:
                raise csv.Error("a quoted cell runs over its end")
            rows.append(row)
    except csv.Error as error:
        what = f"the line can't be split into cells ({error})"
        raise _fail(path, what, "repair its quotes", len(rows) + 1) from error
    while len(rows) > 1 and _is_blank(rows[-1]):
        rows.pop()
    header = [cell.strip() for cell in rows[0]]
    if _is_blank(header):
        raise _fail(path, "the header is blank", "write 'name [unit]' for every column", 1)
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            found = "the line is blank" if _is_blank(row) else f"it has {len(row)}"
            column = None if _is_blank(row) else (*header, "beyond the last")[min(len(row), len(header))]
            raise _fail(path, f"a row must have {len(header)} cells, but {found}", "repair it", line, column)
    if len(rows) < 3:
        what = f"a trace needs at least two samples, but it has {len(rows) - 1}"
        raise _fail(path, what, "export the trace again", len(rows))
    return header, rows[1:], "." if delimiter == "," else ","


def _is_blank(row: Sequence[str]) -> bool:
    return not row or (len(row) == 1 and not row[0].strip())


class _Columns:
    """The header: which column stands where, in which unit."""

    def __init__(self, path: pathlib.Path, header: Sequence[str], ignore: Sequence[str]):
        self.path = path
        self.ignore = ignore
        self.position: dict[str, int] = {}
        self.unit: dict[str, str] = {}
        self.reference: dict[str, str] = {}
        self.notes: list[str] = []
        for position, cell in enumerate(header):
            match = re.fullmatch(r"([^\[\]]*?)\s*(?:\[(.*)\])?", cell)
            if match is None:
                raise self._fail(f"the header '{cell}' must read 'name [unit]'", "write e.g. 'x_d [mm]'", cell)
            self._add(position, match[1].strip(), match[2])

    def _fail(self, what: str, remedy: str, column: str) -> InputError:
        return _fail(self.path, what, remedy, 1, column)

    def _add(self, position: int, name: str, unit: str | None) -> None:
        if name not in UNITS or name in self.ignore:
            self._ignore(name, unit)
            return
        if name in self.position:
            raise self._fail("the column appears twice", "remove or rename one of them", name)
        if unit is None or not unit.strip():
            raise self._fail("the unit is missing", f"write e.g. '{_example(name)}' in the header", name)
        symbol, *reference = unit.split()
        if symbol not in UNITS[name] or (reference and name not in PRESSURES) or len(reference) > 1:
            either = ", each followed by gauge or absolute" if name in PRESSURES else ""
            raise self._fail(
                f"the unit '{unit}' is not known here", f"use one of {', '.join(UNITS[name])}{either}", name
            )
        if name in PRESSURES and reference not in (["gauge"], ["absolute"]):
            raise self._fail(
                f"a pressure must be gauge or absolute, but its unit is '{unit}'",
                f"write '{name} [{symbol} gauge]' or '{name} [{symbol} absolute]'",
                name,
            )
        self.position[name] = position
        self.unit[name] = symbol
        self.reference[name] = "".join(reference)

    def _ignore(self, name: str, unit: str | None) -> None:
        listed = re.split(r"\W", name, maxsplit=1)[0]
        if unit is None and listed in UNITS and name != listed:
            raise self._fail(f"the header '{name}' has no unit in brackets", f"write e.g. '{_example(listed)}'", listed)
        near = [known for known in UNITS if _distance_at_most(name.casefold(), known, 2)]
        if near and name not in UNITS and name not in SIMULATED_ONLY:
            best = difflib.get_close_matches(name, near, n=1, cutoff=0.0)[0]
            raise self._fail(
                f"the name '{name}' looks like a misspelt '{best}'",
                f"write '{best}', or rename the column if it is something else",
                name,
            )
        self.notes.append(f"column '{name}' is not used" if name else "a column without a name is not used")

    def require(self, need: str) -> None:
        alternatives = need.split("|")
        if not any(column in self.position for column in alternatives):
            wanted = " or ".join(f"'{_example(column)}'" for column in alternatives)
            raise self._fail("the column is missing", f"add a column {wanted}", " or ".join(alternatives))

    def to_si(self, name: str, values: Samples, atmosphere: float) -> Samples:
        """Values in SI; pressures absolute, but that of the turbine gauge."""
        factor = 100.0 if (name, self.unit[name]) == ("pwm", "1") else _factor(self.unit[name], _si(name))
        converted = values * factor
        reference = self.reference[name]
        if name == "p_trb":
            return converted - atmosphere if reference == "absolute" else converted
        return converted + atmosphere if reference == "gauge" else converted


def _example(name: str) -> str:
    """A header that is right."""
    unit = "mbar gauge" if name in PRESSURES else "mm" if name == "x_d" else UNITS[name][0]
    return f"{name} [{unit}]"


def _si(name: str) -> str:
    return "s" if name == "time" else SIGNALS[name].unit.split()[0]


@functools.cache
def _factor(unit: str, target: str) -> float:
    """Factor from a unit to its SI unit; pint knows, and is only loaded when it is asked."""
    if unit in (target, "%"):
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
    return row[-1] <= limit


def _numbers(path: pathlib.Path, columns: _Columns, rows: list[list[str]], decimal: str) -> dict[str, Samples]:
    table = {}
    for name, position in columns.position.items():
        cells = [row[position] for row in rows]
        try:
            values = np.array([_to_float(cell, decimal) for cell in cells])
        except ValueError:
            raise _bad_cell(path, name, cells, decimal) from None
        if not np.all(np.isfinite(values)):
            raise _bad_cell(path, name, cells, decimal)
        table[name] = values
    return table


def _to_float(cell: str, decimal: str) -> float:
    # Python reads 1_000 as a thousand; a trace that says so is broken.
    return float(cell.replace(decimal, ".").replace("_", "?"))


def _bad_cell(path: pathlib.Path, name: str, cells: list[str], decimal: str) -> InputError:
    for line, cell in enumerate(cells, 2):
        if not cell.strip():
            return _fail(path, "the cell is blank", "fill it in or remove the row", line, name)
        shown = cell if len(cell) <= 40 else f"{cell[:40]}..."
        try:
            value = _to_float(cell, decimal)
        except ValueError:
            return _fail(path, f"'{shown}' is not a number", "repair the cell", line, name)
        if not np.isfinite(value):
            return _fail(path, f"'{shown}' is not a finite number", "remove the row or repair it", line, name)
    raise AssertionError("called for cells that are all finite numbers")


def _check_time(path: pathlib.Path, time: Samples) -> None:
    steps = np.diff(time)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        what = "stands still" if steps[row - 1] == 0 else "runs back"
        raise _fail(
            path,
            f"time must increase from row to row, but it {what} ({time[row - 1]:.9g} to {time[row]:.9g})",
            "remove the repeated or misplaced rows",
            row + 2,
            "time",
        )
    gaps = steps > GAP * np.median(steps) * (1 + 1e-6)  # five times, but for rounding, is none
    if np.any(gaps):
        row = int(np.argmax(gaps)) + 1
        raise _fail(
            path,
            f"time has a gap of {steps[row - 1]:g} where the median step is {np.median(steps):g}",
            "split the trace there, or record it without loss",
            row + 2,
            "time",
        )


def _ends(atmosphere: float, travel: float) -> dict[str, tuple[float, float]]:
    """What sensor and physics allow, in SI; sensors have offsets."""
    between = (-SENSOR_PRESSURE_OFFSET, atmosphere + SENSOR_PRESSURE_OFFSET)
    return {
        "pwm": (0.0, 100.0),
        "p_act": between,
        "p_res": between,
        "p_trb": (-atmosphere - SENSOR_PRESSURE_OFFSET, HIGHEST_BOOST),
        "x_d": (-SENSOR_POSITION_OFFSET, travel + SENSOR_POSITION_OFFSET),
    }


def _check_range(columns: _Columns, name: str, raw: Samples, values: Samples, ends: tuple[float, float]) -> None:
    low, high = ends
    rounding = 1e-9 * max(abs(end) for end in ends if math.isfinite(end))
    outside = (values < low - rounding) | (values > high + rounding)
    if np.any(outside):
        row = int(np.argmax(outside))
        unit = f"[{' '.join(filter(None, (columns.unit[name], columns.reference[name])))}]"
        si = {"pwm": "%", "x_d": "m", "p_trb": "Pa gauge"}.get(name, "Pa absolute")
        raise _fail(
            columns.path,
            f"{raw[row]:g} {unit} is outside what sensor and physics allow ({low:g} to {high:g} {si})",
            "check the sensor, its unit, and gauge against absolute",
            row + 2,
            name,
        )
