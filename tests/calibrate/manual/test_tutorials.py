"""What the tutorials show of a terminal is compared with it; here, without the minutes that their commands take."""

import pathlib
import re

import pytest
from markdown_pages import name_of

from calibrate.manual import tutorials
from calibrate.manual.markdown import all_blocks, prose
from calibrate.manual.shown import NUMBER, agrees, differences

PAGES = sorted(tutorials.TUTORIALS.glob("*.md"))


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        ("  mass  0.858 %", "mass 0.859 %"),
        ("26 of 26 free", "26 of 26 free"),
        ("off by -1.2e-05 m", "off by -1.21e-05 m"),
        ("RMSE 7.99e-06 ...", "RMSE 8.00e-06   60.1"),
        ("pi knows ...; it measures", "pi knows the middle; it measures"),
        ("a step (10 s)", "a step (10 s)"),
    ],
)
def test_lines_agree(shown, said):
    assert agrees(shown, said)


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        ("mass 0.858 %", "mass 0.901 %"),
        ("26 of 26 free", "25 of 26 free"),
        ("off by -1.2e-05 m", "off by 1.2e-05 m"),
        ("mass 0.858 %", "volume 0.858 %"),
        ("mass 0.858 %", "mass 0.858 % and more"),
        ("step 3", "step none"),
    ],
)
def test_lines_differ(shown, said):
    assert not agrees(shown, said)


def test_lines_may_be_left_out_but_not_change_places():
    assert differences("a 1\nc 3\n", "a 1\nb 2\nc 3\n") == []
    assert differences("c 3\na 1\n", "a 1\nb 2\nc 3\n") == ["shown: a 1\n   said: a 1"]


@pytest.fixture(params=PAGES, ids=name_of)
def page(request) -> pathlib.Path:
    return request.param


def terminal_of(page: pathlib.Path, change=lambda text: text):
    """Runs no command, but says what the page shows of it."""
    lines = iter(shown_lines(page))

    def run(words: list[str], folder: pathlib.Path) -> str:
        if words[3] != "export":
            assert (folder / words[4]).is_file()  # the study has the name that the prose gives it
        return change(next(lines))

    return run


def test_a_tutorial_is_gone_through(page, tmp_path):
    assert list(tutorials.go_through(page, tmp_path, terminal_of(page))) == []


def test_a_figure_that_no_command_says_is_found(page, tmp_path):
    wrong = terminal_of(page, lambda text: re.sub(r"\d", "7", text))
    assert list(tutorials.go_through(page, tmp_path, wrong))


def shown_lines(page: pathlib.Path) -> list[str]:
    """For each command of a page what is shown below it."""
    found: list[str] = []
    for block in all_blocks(page):
        if block.language == "bash":
            found += [""] * sum(line.startswith("python") for line in block.text.splitlines())
        elif block.language == "text":
            found[-1] += block.text
    return found


def test_prose_has_no_figure_that_no_block_has(page):
    """Blocks of text are compared with commands, studies are what is run; a figure from elsewhere would be neither."""
    known = {figure for block in all_blocks(page) for figure in NUMBER.findall(block.text)}
    headings = re.sub(r"^## \d\. ", "", prose(page), flags=re.MULTILINE)
    assert [figure for figure in NUMBER.findall(headings) if figure not in known] == []
