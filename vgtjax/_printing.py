"""How results print themselves: a title, tables and sentences, of text in a terminal and of HTML in a notebook."""

import abc
import html
from collections.abc import Sequence

Cells = Sequence[Sequence[str]]


class Printed(abc.ABC):
    """A result that prints itself."""

    @abc.abstractmethod
    def _title(self) -> str:
        """What stands above the tables."""

    @abc.abstractmethod
    def _tables(self) -> Sequence[Cells]:
        """Tables of cells, the header of each first."""

    def _sentences(self) -> Sequence[str]:
        """What stands below the tables."""
        return ()

    def __repr__(self) -> str:
        return "\n".join([self._title(), *map(text_table, self._tables()), *self._sentences()])

    def _repr_html_(self) -> str:
        below = [f"<p>{html.escape(each)}</p>" for each in self._sentences()]
        return "".join([f"<p>{html.escape(self._title())}</p>", *map(html_table, self._tables()), *below])


def text_table(rows: Cells) -> str:
    """Columns as wide as they must be, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        first, *rest = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join([first.strip().ljust(widths[0]), *rest]).rstrip())
    return "\n".join(lines)


def html_table(rows: Cells) -> str:
    """The same cells as HTML."""

    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{line(rows[0], 'th')}{''.join(line(row, 'td') for row in rows[1:])}</table>"
