"""Tables of the manual that the code makes: `python -m calibrate.manual.tables` writes them into the pages.

They stand there for readers of the repository, between `<!-- options("fit") -->` and `<!-- end -->`; a test sees that
they are current.
"""

import pathlib
import re
from collections.abc import Callable

from . import equations, reference
from .contributing import ROOT

DOCS = ROOT / "docs"
MADE: dict[str, Callable[..., str]] = {
    "channels": reference.channels,
    "designs": reference.designs,
    "equations": equations.index,
    "keys": reference.keys,
    "options": reference.options,
    "other_errata": equations.other_errata,
    "parameters": reference.parameters,
    "words": reference.words,
}
PLACE = re.compile(r'(<!-- (\w+)\((?:"(\w+)")?\) -->\n).*?(<!-- end -->)', flags=re.DOTALL)


def current(page: str) -> str:
    """The text of a page with its tables made anew."""

    def made(match: re.Match[str]) -> str:
        begin, name, argument, end = match.groups()
        return f"{begin}\n{MADE[name](*filter(None, [argument]))}\n\n{end}"

    return PLACE.sub(made, page)


def pages() -> dict[pathlib.Path, str]:
    """The text of every page."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(current(text), encoding="utf-8")
