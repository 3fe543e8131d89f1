"""Pages as a browser shows them: `python -m calibrate.manual.look build/site out/example/report.html`.

Opens every page below the folders, and every page named, from the disk, as a reader does, in a headless Chromium that
is as wide as a desk's window and as a phone. What its console complains of and what is wider than the screen is named,
and the status is 1.
"""

import contextlib
import pathlib
import shutil
import sys
import time
from collections.abc import Iterator

import click
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

WIDTHS = (1300, 390)
"""CSS pixels: of a window on a desk, and of a phone."""
SETTLED = 0.2
"""s after a page has loaded until its scripts have drawn."""
# As root, which a container usually is, Chromium starts without its sandbox only.
OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage")
WIDER = """
const room = document.documentElement.clientWidth
if (document.documentElement.scrollWidth <= room) return []
const cut = element => element && (getComputedStyle(element).overflowX != "visible" || cut(element.parentElement))
const beyond = element => element.getBoundingClientRect().right > room + 1 && !cut(element.parentElement)
const named = element => element.tagName.toLowerCase() + ": " + element.textContent.trim().slice(0, 40)
return ["the page scrolls sideways", ...[...document.body.querySelectorAll("*")].filter(beyond).slice(0, 3).map(named)]
"""
"""What reaches beyond the right edge and makes the page scroll sideways."""


@contextlib.contextmanager
def browser(driver: str) -> Iterator[webdriver.Chrome]:
    """A headless browser until the end of the block."""
    options = webdriver.ChromeOptions()
    for option in OPTIONS:
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    window = webdriver.Chrome(options=options, service=Service(driver))  # a driver that is named is not downloaded
    try:
        yield window
    finally:
        window.quit()


def show(window: webdriver.Chrome, url: str, width: int) -> None:
    """Opens a page on a screen of a width."""
    screen = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    window.get(url)
    time.sleep(SETTLED)


def mistakes(window: webdriver.Chrome, url: str) -> Iterator[str]:
    """A sentence for each mistake of a page, at either width."""
    for width in WIDTHS:
        show(window, url, width)
        errors = [entry["message"] for entry in window.get_log("browser") if entry["level"] == "SEVERE"]
        yield from (f"{url} at {width} px: {said}" for said in [*window.execute_script(WIDER), *errors])


def pages(place: pathlib.Path) -> list[str]:
    """Addresses of a page, or of the pages below a folder, without what only a server shows."""
    found = sorted(place.rglob("*.html")) if place.is_dir() else [place]
    return [page.resolve().as_uri() for page in found if page.name != "404.html"]


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("places", type=click.Path(exists=True, path_type=pathlib.Path), nargs=-1, required=True)
def _command(places: tuple[pathlib.Path, ...]) -> None:
    """Opens pages, and all pages below folders, in a headless Chromium; status 1 if one has an error or overflows."""
    driver = shutil.which("chromedriver")
    if driver is None:
        raise click.ClickException("there is no chromedriver; install Chromium with its driver")
    urls = [url for place in places for url in pages(place)]
    with browser(driver) as window:
        found = [sentence for url in urls for sentence in mistakes(window, url)]
    print("\n".join(found) or f"{len(urls)} pages: none complains, and none is wider than its screen")
    sys.exit(int(bool(found)))


if __name__ == "__main__":
    _command(prog_name="python -m calibrate.manual.look")
