"""Pages of the manual as their readers have them: blocks of code, and the commands in these."""

import pathlib
import re
import shlex
from typing import NamedTuple

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


class Block(NamedTuple):
    """What stands between two fences, and the prose since the last block."""

    language: str
    text: str
    before: str


def all_blocks(page: pathlib.Path) -> list[Block]:
    """The blocks of a page, in order."""
    text, end, found = page.read_text(encoding="utf-8"), 0, []
    for match in FENCE.finditer(text):
        found.append(Block(match[1], match[2], text[end : match.start()]))
        end = match.end()
    return found


def blocks(page: pathlib.Path, language: str) -> list[str]:
    """The blocks of a page in a language."""
    return [block.text for block in all_blocks(page) if block.language == language]


def words_of(shell: str) -> list[list[str]]:
    """The lines of a shell block, each in its words, without what stands in another file's text."""
    text = re.sub(r"<< '(\w+)'\n.*?^\1$", "", shell, flags=re.DOTALL | re.MULTILINE)
    lines = (shlex.split(line, comments=True) for line in text.splitlines())
    return [words for words in lines if words]


def commands(page: pathlib.Path) -> list[list[str]]:
    """The lines of a page's shell blocks."""
    return [words for block in blocks(page, "bash") for words in words_of(block)]


def prose(page: pathlib.Path) -> str:
    """A page without its blocks, without what is quoted as code, and without where its links lead."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return re.sub(r"`[^`]+`|\]\([^)]*\)", "", text)
