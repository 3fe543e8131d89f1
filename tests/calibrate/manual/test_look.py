"""What a browser complains of is named, and what is wider than its screen."""

import pytest
from browsers import DRIVER, NO_BROWSER
from click.testing import CliRunner

pytest.importorskip("selenium", reason="the extra test is not installed")

from calibrate.manual import look

PAGE = "<!doctype html><meta name=viewport content='width=device-width'><title>A page</title><body>{}"


def said(folder, content: str) -> tuple[int, str]:
    """Status and output of the command on a page."""
    page = folder / "page.html"
    page.write_text(PAGE.format(content), encoding="utf-8")
    done = CliRunner().invoke(look._command, [str(folder)])
    return done.exit_code, done.output


@pytest.mark.skipif(DRIVER is None, reason=NO_BROWSER)
@pytest.mark.parametrize(
    ("content", "sentences"),
    [
        ("<p>Words", ["1 pages: none complains, and none is wider than its screen"]),
        ("<div style='overflow: auto'><p style='width: 900px'>Words", ["none complains"]),
        ("<p style='width: 900px'>Words", ["page.html at 390 px: the page scrolls sideways", "390 px: p: Words"]),
        ("<script>nothing.there()</script>", ["1300 px: ", "390 px: ", "nothing is not defined"]),
        ("<script src=gone.js></script>", ["gone.js - Failed to load resource"]),
    ],
)
def test_a_page_is_looked_at(tmp_path, content, sentences):
    status, output = said(tmp_path, content)
    assert [sentence for sentence in sentences if sentence not in output] == []
    assert status == int("none complains" not in output)
    assert ("1300 px" in output) == ("<script" in content)


def test_without_a_driver_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    status, output = said(tmp_path, "<p>Words")
    assert (status, output) == (1, "Error: there is no chromedriver; install Chromium with its driver\n")
