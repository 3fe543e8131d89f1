"""Numbers of reports as they are written there, to be compared with the files of the same run."""

from collections.abc import Iterable, Mapping
from typing import Any

from pages import Page


def shown(value: float | None, digits: int = 5) -> str:
    """A number as a report shows it, and nothing for none."""
    return "" if value is None else f"{value:.{digits}g}"


def um(value: float | None) -> str:
    """A length in m."""
    return "" if value is None else shown(1e6 * value, 4)


def assert_shown(rows: list[dict[str, str]], expected: Iterable[Mapping[str, str]]) -> None:
    """Every row of a table has these cells, and there is no other row."""
    wanted = list(expected)
    assert len(rows) == len(wanted) > 0
    for row, cells in zip(rows, wanted, strict=True):
        assert {name: row[name] for name in cells} == cells


def assert_cards(page: Page, expected: Mapping[str, str]) -> None:
    """The cards on top have these numbers."""
    assert {label: page.cards[label] for label in expected} == expected


def margin_cells(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """The table of margins, by what the summary says of every loop."""
    return [
        {
            "plant": row["plant"],
            "rod": row["rod"],
            "gain": shown(row["gain"], 3),
            "least gain": shown(row["reduction"], 3),
            "phase, deg": shown(row["phase"], 3),
            "delay, ms": "" if row["delay"] is None else shown(1e3 * row["delay"], 3),
            "sensitivity": shown(row["sensitivity"], 3),
            "crossover, rad/s": shown(row["crossover"], 3),
            "stable": "yes" if row["stable"] else "no",
        }
        for row in summary["margins"]
    ]


def target_words(summary: Mapping[str, Any]) -> str:
    """How the report begins to say what a sample takes on the target."""
    sample = summary["sample"]
    took = "" if sample["seconds"] is None else f", {shown(1e6 * sample['seconds'], 3)} us on one core"
    return f"a sample takes {sample['operations']} operations{took}"
