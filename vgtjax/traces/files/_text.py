"""Tables of text (CSV): commas, semicolons with decimal commas, or tabs; one row per sample."""

import csv
import io
import pathlib
from collections.abc import Sequence

import numpy as np

from ..._errors import InputError
from ._recording import Entry, Record, Recording


class TextRecording(Recording):
    """A table whose first row names its columns."""

    noun = "column"
    item = "row"
    is_text = True

    def __init__(self, path: pathlib.Path):
        self.path = path
        header, self._rows, self._decimal = self._split_rows(self._read_text())
        self._signs: dict[str, tuple[Entry, int, str]] = {}  # decimal signs that were read, with the first cell of each
        self.entries = [Entry(cell, key=position) for position, cell in enumerate(header)]

    def place(self, channel: Entry | str | None = None, sample: int | None = None) -> str:
        """File, line (the header is 1) and column."""
        column = channel.label if isinstance(channel, Entry) else channel
        return self._line(1 if sample is None else sample + 2, column)

    def read(self, entry: Entry) -> Record:
        """The numbers of a column."""
        cells = [row[entry.key] for row in self._rows]
        try:
            values = _to_floats(cells, self._decimal)
        except ValueError:
            raise self._bad_cell(entry, cells) from None
        if not np.all(np.isfinite(values)):
            raise self._bad_cell(entry, cells)
        if self._decimal != ".":
            self._require_one_sign(entry, cells)
        return Record(values)

    def _require_one_sign(self, entry: Entry, cells: list[str]) -> None:
        """Refuses points beside decimal commas: they may part thousands, and a value that lost them is a
        thousandth of what it was."""
        for sign in (".", self._decimal):
            first = next((place for place, cell in enumerate(cells) if sign in cell), None)
            if first is not None:
                self._signs.setdefault(sign, (entry, first, cells[first].strip()))
        if len(self._signs) > 1:
            (column, sample, point), (*_, comma) = self._signs["."], self._signs[self._decimal]
            what = f"a file must have one decimal sign, but '{point}' has a point where '{comma}' has a comma"
            raise self.fail(what, "export the trace with one of them, and no sign between thousands", column, sample)

    def _line(self, line: int, column: str | None = None) -> str:
        place = f"{self.path.name}, line {line}"
        return place if column is None else f"{place}, column {column}"

    def _broken(self, what: str, remedy: str, line: int, column: str | None = None) -> InputError:
        return InputError(f"{self._line(line, column)}: {what}; {remedy}")

    def _read_text(self) -> str:
        try:
            raw = self.path.read_bytes()
        except OSError as error:
            what = f"can't be read ({error.strerror}); check the path of the file"
            raise InputError(f"{self.path.name}: {what}") from error
        wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
        if b"\0" in raw and not wide:
            raise self._broken("this is a binary file, not text", "export the trace as CSV", 1)
        try:
            text = raw.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            raise self._broken("this is not UTF-8 text", "export the trace as CSV in UTF-8", line) from error
        if not text.strip():
            raise self._broken("the file is empty", "export the trace again", 1)
        return text

    def _split_rows(self, text: str) -> tuple[list[str], list[list[str]], str]:
        """The header, the rows below it, and the decimal sign that goes with the delimiter."""
        first = text.split("\n", 1)[0]
        delimiter = ";" if ";" in first else "\t" if "\t" in first else ","
        rows = self._cells(text, delimiter)
        while len(rows) > 1 and _is_blank(rows[-1]):
            rows.pop()
        header = [cell.strip() for cell in rows[0]]
        if _is_blank(header):
            raise self._broken("the header is blank", "write 'name [unit]' for every column", 1)
        for line, row in enumerate(rows[1:], 2):
            if len(row) != len(header):
                found = "the line is blank" if _is_blank(row) else f"it has {len(row)}"
                column = None if _is_blank(row) else (*header, "beyond the last")[min(len(row), len(header))]
                raise self._broken(f"a row must have {len(header)} cells, but {found}", "repair it", line, column)
        if len(rows) < 3:
            what = f"a trace needs at least two samples, but it has {len(rows) - 1}"
            raise self._broken(what, "export the trace again", len(rows))
        return header, rows[1:], "." if delimiter == "," else ","

    def _cells(self, text: str, delimiter: str) -> list[list[str]]:
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
            raise self._broken(what, "repair its quotes", len(rows) + 1) from error
        return rows

    def _bad_cell(self, column: Entry, cells: list[str]) -> InputError:
        for sample, cell in enumerate(cells):
            if not cell.strip():
                return self.fail("the cell is blank", "fill it in or remove the row", column, sample)
            shown = cell if len(cell) <= 40 else f"{cell[:40]}..."
            try:
                (value,) = _to_floats([cell], self._decimal)
            except ValueError:
                return self.fail(f"'{shown}' is not a number", "repair the cell", column, sample)
            if not np.isfinite(value):
                what = f"'{shown}' is not a finite number"
                return self.fail(what, "remove the row or repair it", column, sample)
        raise AssertionError("called for cells that are all finite numbers")


def _is_blank(row: Sequence[str]) -> bool:
    return not row or (len(row) == 1 and not row[0].strip())


def _to_floats(cells: Sequence[str], decimal: str) -> np.ndarray:
    # Python reads 1_000 as a thousand; a trace that says so is broken.
    if any("_" in cell for cell in cells):
        raise ValueError("an underscore is no part of a number")
    if decimal != ".":
        cells = [cell.replace(decimal, ".") for cell in cells]
    return np.array([float(cell) for cell in cells])
