"""README and manual as their readers have them: pages, their blocks of code, their commands."""

import pathlib
import re
import shlex

ROOT = pathlib.Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = [README, *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def name_of(page: pathlib.Path) -> str:
    """A page as a test's name has it."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: pathlib.Path, language: str) -> list[str]:
    """The blocks of a page in a language."""
    return [text for found, text in FENCE.findall(page.read_text(encoding="utf-8")) if found == language]


def commands(page: pathlib.Path) -> list[list[str]]:
    """The lines of a page's shell blocks, each in its words, without what stands in another file's text."""
    lines = []
    for block in blocks(page, "bash"):
        text = re.sub(r"<< '(\w+)'\n.*?^\1$", "", block, flags=re.DOTALL | re.MULTILINE)
        lines += [shlex.split(line, comments=True) for line in text.splitlines()]
    return [words for words in lines if words]
