"""README and manual, page by page."""

import pathlib

from calibrate.manual.contributing import ROOT

DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = [README, *sorted(DOCS.rglob("*.md"))]


def name_of(page: pathlib.Path) -> str:
    """A page as a test's name has it."""
    return page.relative_to(ROOT).as_posix()
