"""The tables of CONTRIBUTING: where each equation of the thesis is, what its print has wrong, which word means what."""

import dataclasses
import pathlib
import re

ROOT = pathlib.Path(__file__).parents[2]
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"(?<![\w.])(?<!Table )(?<!section )([A-C]|\d)\.(\d+)(?:-(?:\1\.)?(\d+))?\b(?!\.\d)")
"""A number of the thesis, or the first and the last of several."""


@dataclasses.dataclass(frozen=True)
class EquationRow:
    """A row of the table of equations, with the errata of its numbers."""

    title: str
    what: str
    code: str
    test: str
    numbers: tuple[str, ...]
    errata: tuple["Erratum", ...] = ()


@dataclasses.dataclass(frozen=True)
class Erratum:
    """A mistake of the print, what we do, and the test of it."""

    mistake: str
    remedy: str
    test: str

    @property
    def numbers(self) -> set[str]:
        """Equations whose print is wrong; numbers behind the first colon of each part only refer to others."""
        parts = (part.partition(":")[0] for part in self.mistake.split(";"))
        return {number for part in parts for number in numbers_in(part)}


def table(heading: str) -> list[list[str]]:
    """The cells of the rows below a table's heading."""
    lines = CONTRIBUTING.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(f"| {heading} |"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def numbers_in(text: str) -> list[str]:
    """Every number of an equation in a text, ranges taken apart."""
    found = []
    for chapter, first, last in NUMBER.findall(text):
        found += [f"{chapter}.{number}" for number in range(int(first), int(last or first) + 1)]
    return found


def errata() -> list[Erratum]:
    """All mistakes of the print."""
    return [Erratum(*cells) for cells in table("erratum of the print")]


def equations() -> list[EquationRow]:
    """All rows of the table of equations, in the thesis's order, each with its errata."""
    rows = []
    for title, what, code, test in table("equation"):
        numbers = tuple(numbers_in(title)) if not title.startswith("section") else ()
        found = tuple(erratum for erratum in errata() if erratum.numbers & set(numbers))
        rows.append(EquationRow(title, what, code, test, numbers, found))
    return sorted(rows, key=_place)


def _place(row: EquationRow) -> tuple[str, int]:
    """Chapter and first number of a row."""
    chapter, first = re.findall(r"([A-C]|\d)\.(\d+)", row.title)[0]
    return chapter, int(first)
