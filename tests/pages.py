"""What of a report matters to tests: its text by tag, what it refers to, its tables."""

import html.parser

LOADS = {"src", "href", "data", "poster", "action", "background", "srcset", "xlink:href"}
"""Attributes by which a page loads or leads elsewhere."""


class Page(html.parser.HTMLParser):
    """What of a page matters here: its text by tag, what it refers to, and its tags."""

    def __init__(self, text: str):
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.rows: list[list[str]] = []
        """The cells of every row of every table."""
        self.cards: dict[str, str] = {}
        """What the cards on top say, by their labels."""
        self._card, self._label = False, ""
        self._open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag == "table":
            self.rows.append([])  # nothing of one table is below another's heading
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self._card = ("class", "card") in attributes or (tag == "b" and self._card)
        self._open.append(tag)
        self.references += [value for name, value in attributes if name in LOADS]

    def handle_endtag(self, tag):
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data):
        if self._open:
            self.texts.setdefault(self._open[-1], []).append(data)
        if self._card and self._open[-1] == "b":
            self.cards[self._label] = data
        elif self._card:
            self._label = data
        if {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data

    def text(self, tag: str) -> str:
        return "\n".join(self.texts.get(tag, []))

    def table(self, *heading: str) -> list[dict[str, str]]:
        """The rows of the first table whose heading begins like that; as `tables`."""
        return self.tables(*heading)[0]

    def tables(self, *heading: str) -> list[list[dict[str, str]]]:
        """The rows below each heading whose cells begin like that, each by its heading, up to the next heading.

        Of a name that stands in a heading more than once, the second is `name (2)`.
        """
        found = []
        for start, cells in enumerate(self.rows):
            if cells[: len(heading)] != list(heading):
                continue
            names = [name + f" ({count})" * (count > 1) for name, count in zip(cells, _counted(cells), strict=True)]
            found.append([])
            for row in self.rows[start + 1 :]:
                if len(row) != len(names):
                    break
                found[-1].append(dict(zip(names, row, strict=True)))
        return found


def _counted(cells: list[str]) -> list[int]:
    """Of every cell, the how-manieth of its kind it is."""
    return [cells[: place + 1].count(cell) for place, cell in enumerate(cells)]
