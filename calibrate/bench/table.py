"""Results as tables, on the terminal and as markdown."""

import dataclasses

import rich.console
import rich.table


@dataclasses.dataclass
class Section:
    """One benchmark: `about` says what problem of what size, `notes` what to know when reading the rows."""

    title: str
    about: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)

    def add(self, *cells: str) -> None:
        """Adds a row."""
        if len(cells) != len(self.columns):
            raise ValueError(f"a row needs {len(self.columns)} cells, but it has {len(cells)}; give one a column")
        self.rows.append(cells)


def seconds(value: float) -> str:
    """A duration with three digits in the unit that suits it."""
    if value < 1e-3:
        return f"{value * 1e6:.3g} us"
    return f"{value * 1e3:.3g} ms" if value < 1 else f"{value:.3g} s" if value < 1000 else f"{value:.0f} s"


def times(value: float) -> str:
    """A ratio."""
    return f"{value:.2f} x" if value < 10 else f"{value:.0f} x"


def show(section: Section, console: rich.console.Console) -> None:
    """Prints a section."""
    console.print(f"\n[bold]{section.title}[/bold]\n{section.about}", highlight=False)
    table = rich.table.Table()
    for number, column in enumerate(section.columns):
        table.add_column(column, no_wrap=number == 0, justify="left" if number == 0 else "right")
    for row in section.rows:
        table.add_row(*row)
    console.print(table)
    for note in section.notes:
        console.print(f"- {note}", highlight=False, markup=False)


def to_markdown(sections: list[Section], machine: str) -> str:
    """All sections as one document."""
    lines = ["# Benchmarks", "", machine]
    for section in sections:
        lines += ["", f"## {section.title}", "", section.about, ""]
        lines += [_markdown_row(section.columns), _markdown_row(("---",) * len(section.columns))]
        lines += [_markdown_row(row) for row in section.rows]
        if section.notes:
            lines += ["", *[f"- {note}" for note in section.notes]]
    return "\n".join(lines) + "\n"


def _markdown_row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
