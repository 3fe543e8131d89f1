"""The site builds strictly, loads nothing from elsewhere, and no link in it is dead."""

import contextlib
import html.parser
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tomllib
import urllib.parse

import pytest
from markdown_pages import DOCS, PAGES, README, ROOT, name_of

pytest.importorskip("zensical", reason="the extra docs is not installed")
pytest.importorskip("selenium", reason="the extra test is not installed")

from browsers import DRIVER, NO_BROWSER
from selenium.common import exceptions
from selenium.webdriver.support import ui as waiting

from calibrate.manual import look, reference
from calibrate.manual.contributing import equations, errata
from calibrate.manual.equations import heading

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "object": "data"}
"""What a page loads by itself."""
NEEDED = ("vgtjax", "calibrate", "CONTRIBUTING.md", "zensical.toml")
FIRST = 3
"""Results of a search that one looks at."""
TYPED = 10
"""Of so many numbers of equations one is typed: all of them take minutes."""
OPENED = 4
"""Of so many pages one is opened: `python -m calibrate.manual.look build/site` opens all."""
PATIENCE = 60
"""s, ten times what a browser takes on a machine that does nothing else."""


class Page(html.parser.HTMLParser):
    """What a page loads, where it leads, and what in it can be led to."""

    def __init__(self, text: str):
        super().__init__()
        self.loads: list[str] = []
        self.leads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors.update(given[name] for name in ("id", "name") if given.get(name))
        if given.get(LOADED.get(tag, "")):
            self.loads.append(given[LOADED[tag]])
        if tag == "a" and given.get("href"):
            self.leads.append(given["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> pathlib.Path:
    """The site, built strictly, from a copy of what it is made of."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(DOCS, folder / "docs")
    for name in NEEDED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__", "example"))
        else:
            shutil.copy(source, folder / name)
    environment = os.environ | {"PYTHONPATH": str(folder), "JAX_PLATFORMS": "cpu"}
    built = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    assert "No issues found" in built.stderr
    return folder / "build" / "site"


@pytest.fixture(scope="module")
def pages(site) -> dict[str, Page]:
    """Every page by its path in the site."""
    found = sorted(site.rglob("*.html"))
    return {path.relative_to(site).as_posix(): Page(path.read_text(encoding="utf-8")) for path in found}


def test_every_page_is_in_the_site_and_its_navigation(pages):
    sources = {path.relative_to(DOCS).with_suffix(".html").as_posix() for path in DOCS.rglob("*.md")}
    assert set(pages) - {"404.html"} == sources
    project = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]
    named = [page for section in project["nav"] for _, page in entries(section)]
    assert sorted(named) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def entries(section: dict) -> list[tuple[str, str]]:
    """Titles and pages of a part of the navigation."""
    found: list[tuple[str, str]] = []
    for title, content in section.items():
        found += (
            [(title, content)] if isinstance(content, str) else [each for part in content for each in entries(part)]
        )
    return found


def test_nothing_is_loaded_from_elsewhere(site, pages):
    loads = [(name, url) for name, page in pages.items() for url in page.loads if urllib.parse.urlparse(url).netloc]
    assert loads == []
    styles = "\n".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    assert "url(http" not in styles
    assert "@import" not in styles


def test_no_link_is_dead(pages, site):
    links = [(name, link) for name, page in pages.items() for link in [*page.leads, *page.loads] if name != "404.html"]
    inside = [(name, link) for name, link in links if not urllib.parse.urlparse(link).scheme]
    assert len(inside) > 1000
    assert [(name, link) for name, link in inside if not leads_somewhere(name, link, pages, site)] == []


def leads_somewhere(name: str, link: str, pages: dict[str, Page], site: pathlib.Path) -> bool:
    """Whether a link on a page ends at a file of the site, and at an anchor that is there."""
    url = urllib.parse.urlparse(link)
    target = os.path.normpath(pathlib.PurePosixPath(name).parent / url.path) if url.path else name
    if target not in pages:
        return (site / target).is_file()
    return not url.fragment or urllib.parse.unquote(url.fragment) in pages[target].anchors


def test_a_dead_link_is_seen(pages, site):
    assert not leads_somewhere("index.html", "speed.html#no-such-heading", pages, site)
    assert not leads_somewhere("index.html", "no_such_page.html", pages, site)


def test_links_to_elsewhere_are_whole(pages):
    leads = {link for page in pages.values() for link in page.leads if urllib.parse.urlparse(link).scheme}
    assert len(leads) > 5
    for link in leads:
        url = urllib.parse.urlparse(link)
        assert url.scheme == "https"
        assert "." in url.netloc


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_of_a_page_lead_somewhere_in_the_repository_too(page):
    text = page.read_text(encoding="utf-8")
    targets = [found.partition(")")[0] for found in text.split("](")[1:]]
    for target in targets:
        path = target.partition("#")[0]
        if path and not path.startswith("https://"):
            assert (page.parent / path).exists(), target
            assert page == README or DOCS in (page.parent / path).resolve().parents, target


def test_each_equation_is_found_with_its_file_its_test_and_its_errata(site):
    items = json.loads((site / "search.json").read_text(encoding="utf-8"))["items"]
    sections = [item for item in items if item["location"].startswith("equations.html#")]
    numbers = {number for row in equations() for number in row.numbers}
    assert len(numbers) > 200
    for row in equations():
        (section,) = [item for item in sections if item["title"] == heading(row)]
        shown = section["title"] + section["text"]
        assert all(f"({number})" in shown for number in row.numbers)
        assert all(file in shown for file in re.findall(r"test_\w+\.py", row.test))
        assert all(name in shown for name in re.findall(r"`(?:[^`:]+: )?(\w+)`", row.code))
        assert all(file in shown for file in re.findall(r"[\w/]+\.py", row.code))
        assert shown.count("Erratum") == len(row.errata)
    everything = " ".join(item["text"] for item in sections)
    assert everything.count("Erratum") >= len(errata())


def test_every_public_name_has_its_place(pages):
    for room in reference.ROOMS:
        missing = [
            name
            for name in reference.public_names(room)
            if f"vgtjax.{room}.{name}" not in pages[f"api/{room}.html"].anchors
        ]
        assert missing == []


def test_parameters_stand_beside_their_classes_with_unit_and_source(site):
    text = (site / "api" / "parts.html").read_text(encoding="utf-8")
    _, _, lugre = text.partition('id="vgtjax.parts.LuGre"')
    row = lugre[lugre.index("<code>bristle_stiffness</code>") :]
    cells = [cell.partition("</td>")[0] for cell in row.split("<td>")[1:5]]
    assert cells == ["sigma_0", "N/m", "43135", "B.2"]


@pytest.fixture(scope="module")
def window():
    """A browser, where there is one."""
    if DRIVER is None:
        pytest.skip(NO_BROWSER)
    with look.browser(DRIVER) as opened:
        yield opened


def test_pages_do_not_complain_in_a_browser_and_fit_its_screen(window, site):
    opened = look.pages(site)[::OPENED]
    assert len(opened) > 10
    assert [sentence for url in opened for sentence in look.mistakes(window, url)] == []


class Search:
    """The box that a reader types into, in a page that is opened from the disk."""

    def __init__(self, window, page: pathlib.Path):
        look.show(window, page.as_uri(), look.WIDTHS[0])
        window.find_element("css selector", ".md-search__button").click()
        waiting.WebDriverWait(window, PATIENCE).until(lambda _: self.inside(window))
        self.root = self.inside(window)
        self.window = window

    @staticmethod
    def inside(window):
        """What the box and its results are in, once it is open."""
        script = "return document.activeElement.shadowRoot"
        return window.execute_script(script)

    def __call__(self, text: str, page: str) -> list[str]:
        """Where the first results lead, once one is on that page: until then they may be those of half of the text."""
        box = self.root.find_element("css selector", "input")
        box.clear()
        box.send_keys(text)
        first: list[str] = []

        def found(_) -> bool:
            first[:] = self.results(text)[:FIRST]
            return any(each.startswith(f"{page}#") for each in first)

        with contextlib.suppress(exceptions.TimeoutException):
            waiting.WebDriverWait(self.window, PATIENCE, 0.02).until(found)
        return first

    def results(self, text: str) -> list[str]:
        """Those that have what was typed marked in their title; none while those of an earlier text are shown."""
        script = "return [...arguments[0].querySelectorAll('a')].map(each => [each.href, each.innerText])"
        found = self.window.execute_script(script, self.root)
        return [href.rpartition("/")[2] for href, shown in found if text in shown]


def test_the_search_finds_equations_in_a_browser(window, site):
    search = Search(window, site / "index.html")
    numbers = [number for row in equations() for number in row.numbers]
    found = {number: search(number, "equations.html") for number in numbers[::TYPED]}
    missed = {n: first for n, first in found.items() if not any(each.startswith("equations.html#") for each in first)}
    assert missed == {}
