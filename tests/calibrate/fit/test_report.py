"""The report carries all it shows, and what is needed to repeat it."""

import html.parser
import importlib.metadata
import re

import pytest
from commands import read

LOADS = {"src", "href", "data", "poster", "action", "background", "srcset", "xlink:href"}
"""Attributes by which a page loads or leads elsewhere."""


class Page(html.parser.HTMLParser):
    """What of a page matters here: its text by tag, what it refers to, and its tags."""

    def __init__(self, text: str):
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self._open.append(tag)
        self.references += [value for name, value in attributes if name in LOADS]

    def handle_endtag(self, tag):
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data):
        if self._open:
            self.texts.setdefault(self._open[-1], []).append(data)

    def text(self, tag: str) -> str:
        return "\n".join(self.texts.get(tag, []))


@pytest.fixture(scope="module")
def page(fitted):
    return Page((fitted.out / "report.html").read_text(encoding="utf-8"))


def test_nothing_is_loaded_from_elsewhere(page):
    assert [reference for reference in page.references if not reference.startswith("#")] == []
    assert not {"link", "iframe", "img", "object", "embed", "base"} & set(page.tags)
    assert not re.search(r"@import|url\(", page.text("style"))


def test_the_plots_and_their_library_are_inside(page):
    assert "plotly.js v" in page.text("script")
    # A trace each: signals, loop. The laws: magnet, areas, Phi, friction. Correlations, autocorrelation, convergence.
    assert page.text("script").count("Plotly.newPlot(") == 2 * 2 + 4 + 3


def test_the_study_is_inside_word_by_word(page, fitted):
    assert page.text("pre").startswith(fitted.study.read_text())
    assert page.text("h1") == "small & quick"


@pytest.mark.parametrize("package", ["vgtjax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy"])
def test_versions_are_inside(page, package):
    assert f"{package} {importlib.metadata.version(package)}" in page.text("p")


def test_the_fingerprint_is_that_of_the_summary(page, fitted):
    assert read(fitted.out / "summary.json")["study_sha256"][:16] in page.text("code")


def test_every_parameter_has_its_row(page, fitted):
    shown = page.text("code").splitlines()
    for name, fields in read(fitted.out / "parameters.json")["parameters"].items():
        size = len(fields["value"]) if isinstance(fields["value"], list) else None
        for entry in [name] if size is None else [f"{name}[{i}]" for i in range(size)]:
            assert entry in shown


def test_assumed_values_are_marked(page):
    assert "held, assumed" in page.text("td")


def test_both_uses_are_told_apart(page):
    assert {"fit", "validate"} <= set(page.text("td").splitlines())
    assert "converged" in page.text("b").splitlines()
