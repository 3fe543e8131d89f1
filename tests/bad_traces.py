"""Traces that break one rule each, and the sentence that answers it; the file is called `bench.csv`."""

import dataclasses

HEADER = "time [s],pwm [%],p_act [mbar gauge],p_res [mbar gauge],x_d [mm]"
ROWS = tuple(f"{i / 1000:.3f},{50 if i > 4 else 0},{-10.0 * i:.1f},-800.0,{0.1 * i:.2f}" for i in range(12))
RANGE_REMEDY = "check the sensor, its unit, and gauge against absolute"
POSITION_ENDS = f"sensor and physics allow (-0.0005 to 0.01063 m); {RANGE_REMEDY}"


def text(header: str = HEADER, rows: tuple[str, ...] = ROWS) -> str:
    """A trace as text; as it stands, a good one."""
    return "\n".join([header, *rows]) + "\n"


def with_header(old: str, new: str) -> str:
    """The good trace with a part of its header replaced."""
    assert old in HEADER
    return text(HEADER.replace(old, new))


def with_line(line: int, row: str) -> str:
    """The good trace with one line replaced; the header is line 1."""
    return text(rows=(*ROWS[: line - 2], row, *ROWS[line - 1 :]))


def with_cell(line: int, column: str, cell: str) -> str:
    """The good trace with one cell replaced."""
    cells = ROWS[line - 2].split(",")
    cells[[name.split(" ")[0] for name in HEADER.split(",")].index(column)] = cell
    return with_line(line, ",".join(cells))


def without_column(column: str) -> str:
    """The good trace without one of its columns."""
    table = [row.split(",") for row in (HEADER, *ROWS)]
    kept = [i for i, name in enumerate(table[0]) if not name.startswith(column)]
    return "\n".join(",".join(row[i] for i in kept) for row in table) + "\n"


def _long_with_a_bad_end() -> str:
    rows = [f"{i / 1000:.3f},0,0.0,-800.0,0.00" for i in range(999)]
    return text(rows=(*rows, "0.999,0,0.0,-800.0,n/a"))


@dataclasses.dataclass(frozen=True)
class BadTrace:
    """A rule, a file that breaks it, and what the reader says after the file's name."""

    rule: str
    content: str | bytes
    sentence: str

    @property
    def raw(self) -> bytes:
        """The bytes of the file."""
        return self.content if isinstance(self.content, bytes) else self.content.encode()


COLUMNS = (
    BadTrace(
        "time is missing",
        without_column("time"),
        "line 1, column time: the column is missing; add a column 'time [s]', or state in channels which column is "
        "which",
    ),
    BadTrace(
        "the input is missing",
        without_column("pwm"),
        "line 1, column pwm: the column is missing; add a column 'pwm [%]', or state in channels which column is which",
    ),
    BadTrace(
        "there is no header",
        text(ROWS[0]),
        "line 1, column time: the column is missing; add a column 'time [s]', or state in channels which column is "
        "which",
    ),
    BadTrace(
        "two letters swapped",
        with_header("p_act", "p_atc"),
        "line 1, column p_atc: the name 'p_atc' looks like a misspelt 'p_act'; write 'p_act', or state "
        "in channels which column is which",
    ),
    BadTrace(
        "one letter missing",
        with_header("p_res", "pres"),
        "line 1, column pres: the name 'pres' looks like a misspelt 'p_res'; write 'p_res', or state "
        "in channels which column is which",
    ),
    BadTrace(
        "capital letters",
        with_header("p_act", "P_ACT"),
        "line 1, column P_ACT: the name 'P_ACT' looks like a misspelt 'p_act'; write 'p_act', or state "
        "in channels which column is which",
    ),
    BadTrace(
        "a column twice",
        with_header("p_res", "p_act"),
        "line 1, column p_act: the column appears twice; remove or rename one of them",
    ),
    BadTrace(
        "a column twice in different units",
        with_header("p_res [mbar gauge]", "x_d [m]"),
        "line 1, column x_d: the column appears twice; remove or rename one of them",
    ),
)

UNITS = (
    BadTrace(
        "an unknown unit",
        with_header("[mm]", "[inch]"),
        "line 1, column x_d: the unit 'inch' is not known here; use one of m, mm, um",
    ),
    BadTrace(
        "an unknown unit of a pressure",
        with_header("p_act [mbar gauge]", "p_act [psi gauge]"),
        "line 1, column p_act: the unit 'psi gauge' is not known here; use one of Pa, kPa, mbar, bar, each followed by "
        "gauge or absolute",
    ),
    BadTrace(
        "gauge where it has no sense",
        with_header("[mm]", "[mm gauge]"),
        "line 1, column x_d: the unit 'mm gauge' is not known here; use one of m, mm, um",
    ),
    BadTrace(
        "no unit",
        with_header("x_d [mm]", "x_d"),
        "line 1, column x_d: the unit is missing; write e.g. 'x_d [mm]' in the header",
    ),
    BadTrace(
        "an empty unit",
        with_header("[s]", "[ ]"),
        "line 1, column time: the unit is missing; write e.g. 'time [s]' in the header",
    ),
    BadTrace(
        "a unit in round brackets",
        with_header("x_d [mm]", "x_d (mm)"),
        "line 1, column x_d: the header 'x_d (mm)' has no unit in brackets; write e.g. 'x_d [mm]'",
    ),
    BadTrace(
        "a bracket that does not close",
        with_header("x_d [mm]", "x_d [mm"),
        "line 1, column x_d [mm: the header 'x_d [mm' must read 'name [unit]'; write e.g. 'x_d [mm]'",
    ),
    BadTrace(
        "a pressure neither gauge nor absolute",
        with_header("p_act [mbar gauge]", "p_act [mbar]"),
        "line 1, column p_act: a pressure must be gauge or absolute, but its unit is 'mbar'; write 'p_act [mbar "
        "gauge]' or 'p_act [mbar absolute]'",
    ),
    BadTrace(
        "a pressure against something else",
        with_header("p_res [mbar gauge]", "p_res [kPa relative]"),
        "line 1, column p_res: a pressure must be gauge or absolute, but its unit is 'kPa relative'; write 'p_res [kPa "
        "gauge]' or 'p_res [kPa absolute]'",
    ),
)

CELLS = (
    BadTrace(
        "text in a number",
        with_cell(7, "p_act", "12.3a"),
        "line 7, column p_act: '12.3a' is not a number; repair the cell",
    ),
    BadTrace(
        "a thousand with an underscore",
        with_cell(7, "p_res", "-8_00"),
        "line 7, column p_res: '-8_00' is not a number; repair the cell",
    ),
    BadTrace(
        "text in the last of a thousand lines",
        _long_with_a_bad_end(),
        "line 1001, column x_d: 'n/a' is not a number; repair the cell",
    ),
    BadTrace(
        "not a number",
        with_cell(4, "x_d", "NaN"),
        "line 4, column x_d: 'NaN' is not a finite number; remove the row or repair it",
    ),
    BadTrace(
        "infinity",
        with_cell(13, "x_d", "-inf"),
        "line 13, column x_d: '-inf' is not a finite number; remove the row or repair it",
    ),
    BadTrace(
        "a number too large to be one",
        with_cell(2, "p_act", "1e999"),
        "line 2, column p_act: '1e999' is not a finite number; remove the row or repair it",
    ),
    BadTrace(
        "a blank cell",
        with_cell(9, "pwm", ""),
        "line 9, column pwm: the cell is blank; fill it in or remove the row",
    ),
    BadTrace(
        "a cell of spaces",
        with_cell(9, "pwm", "  "),
        "line 9, column pwm: the cell is blank; fill it in or remove the row",
    ),
    BadTrace(
        "a thousands separator",
        text().replace(",", ";").replace("-800.0", "-1.800,0"),
        "line 2, column p_res: '-1.800,0' is not a number; repair the cell",
    ),
    BadTrace(
        "a point between thousands beside decimal commas",
        text().replace(",", ";").replace(".", ",").replace("-800,0", "-1.000"),
        "line 2, column p_res: a file must have one decimal sign, but '-1.000' has a point where '-0,0' has a comma; "
        "export the trace with one of them, and no sign between thousands",
    ),
)

ROWS_AND_FILES = (
    BadTrace(
        "a short row",
        with_line(5, "0.003,0,0.0,-800.0"),
        "line 5, column x_d [mm]: a row must have 5 cells, but it has 4; repair it",
    ),
    BadTrace(
        "a long row",
        with_line(5, "0.003,0,0.0,-800.0,0.0,1"),
        "line 5, column beyond the last: a row must have 5 cells, but it has 6; repair it",
    ),
    BadTrace(
        "decimal commas between commas",
        with_line(2, "0,000,0,0,0,-800,0,0,00"),
        "line 2, column beyond the last: a row must have 5 cells, but it has 9; repair it",
    ),
    BadTrace(
        "a delimiter after every row but the header",
        text(rows=tuple(f"{row}," for row in ROWS)),
        "line 2, column beyond the last: a row must have 5 cells, but it has 6; repair it",
    ),
    BadTrace(
        "a blank line between rows",
        with_line(6, ""),
        "line 6: a row must have 5 cells, but the line is blank; repair it",
    ),
    BadTrace(
        "a line of spaces between rows",
        with_line(6, "   "),
        "line 6: a row must have 5 cells, but the line is blank; repair it",
    ),
    BadTrace(
        "a blank line first",
        "\n" + text(),
        "line 1: the header is blank; write 'name [unit]' for every column",
    ),
    BadTrace(
        "a quote that does not close",
        with_cell(3, "time", '"0.001'),
        "line 3: the line can't be split into cells (unexpected end of data); repair its quotes",
    ),
    BadTrace(
        "a header alone", HEADER, "line 1: a trace needs at least two samples, but it has 0; export the trace again"
    ),
    BadTrace(
        "one sample",
        text(rows=ROWS[:1]),
        "line 2: a trace needs at least two samples, but it has 1; export the trace again",
    ),
    BadTrace("an empty file", b"", "line 1: the file is empty; export the trace again"),
    BadTrace("a byte-order mark alone", b"\xef\xbb\xbf", "line 1: the file is empty; export the trace again"),
    BadTrace("nothing but line ends", "\r\n\r\n", "line 1: the file is empty; export the trace again"),
    BadTrace(
        "a binary file",
        b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR",
        "line 1: this is a binary file, not text; export the trace as CSV",
    ),
    BadTrace(
        "bytes that are no UTF-8",
        text().replace("0.002,0", "0.002,°").encode("latin-1"),
        "line 4: this is not UTF-8 text; export the trace as CSV in UTF-8",
    ),
)

TIMES = (
    BadTrace(
        "time stands still",
        with_cell(6, "time", "0.003"),
        "line 6, column time: time must increase from row to row, but it stands still (0.003 to 0.003); remove the "
        "repeated or misplaced rows",
    ),
    BadTrace(
        "time runs back",
        with_cell(6, "time", "0.001"),
        "line 6, column time: time must increase from row to row, but it runs back (0.003 to 0.001); remove the "
        "repeated or misplaced rows",
    ),
    BadTrace(
        "a gap",
        with_cell(13, "time", "0.016"),
        "line 13, column time: time has a gap of 0.006 where the median step is 0.001; split the trace there, or "
        "record it without loss",
    ),
)

VALUES = (
    BadTrace(
        "a duty over 100 %",
        with_cell(8, "pwm", "100.5"),
        f"line 8, column pwm: 100.5 [%] is outside what sensor and physics allow (0 to 100 %); {RANGE_REMEDY}",
    ),
    BadTrace(
        "a duty below 0 %",
        with_cell(8, "pwm", "-0.1"),
        f"line 8, column pwm: -0.1 [%] is outside what sensor and physics allow (0 to 100 %); {RANGE_REMEDY}",
    ),
    BadTrace(
        "percent written as a fraction",
        with_header("pwm [%]", "pwm [1]"),
        f"line 7, column pwm: 50 [1] is outside what sensor and physics allow (0 to 100 %); {RANGE_REMEDY}",
    ),
    BadTrace(
        "a pressure below vacuum",
        with_cell(4, "p_act", "-1100"),
        "line 4, column p_act: -1100 [mbar gauge] is outside what sensor and physics allow (-5000 to 106013 Pa "
        f"absolute); {RANGE_REMEDY}",
    ),
    BadTrace(
        "gauge written as absolute",
        with_header("p_res [mbar gauge]", "p_res [mbar absolute]"),
        "line 2, column p_res: -800 [mbar absolute] is outside what sensor and physics allow (-5000 to 106013 Pa "
        f"absolute); {RANGE_REMEDY}",
    ),
    BadTrace(
        "a chamber above atmosphere",
        with_cell(4, "p_act", "51"),
        "line 4, column p_act: 51 [mbar gauge] is outside what sensor and physics allow (-5000 to 106013 Pa absolute); "
        f"{RANGE_REMEDY}",
    ),
    BadTrace(
        "a turbine inlet below vacuum",
        with_header("p_res", "p_trb").replace("-800.0", "-1064"),
        "line 2, column p_trb: -1064 [mbar gauge] is outside what sensor and physics allow (-106013 to 2e+06 Pa "
        f"gauge); {RANGE_REMEDY}",
    ),
    BadTrace(
        "beyond the open stop",
        with_cell(2, "x_d", "-0.51"),
        f"line 2, column x_d: -0.51 [mm] is outside what {POSITION_ENDS}",
    ),
    BadTrace(
        "beyond the closed stop",
        with_cell(13, "x_d", "10.64"),
        f"line 13, column x_d: 10.64 [mm] is outside what {POSITION_ENDS}",
    ),
    BadTrace(
        "millimetres written as metres",
        with_header("[mm]", "[m]"),
        f"line 3, column x_d: 0.1 [m] is outside what {POSITION_ENDS}",
    ),
)

BAD_TRACES = {case.rule: case for case in (*COLUMNS, *UNITS, *CELLS, *ROWS_AND_FILES, *TIMES, *VALUES)}
