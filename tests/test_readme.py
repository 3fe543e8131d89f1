"""The README says what is true: its code runs, its commands are CI's, its files exist, and it fits on a page."""

import pathlib
import re

import pytest
from markdown_pages import README, ROOT
from python_blocks import python_block
from support import EXAMPLE

import vgtjax
from calibrate.manual.markdown import blocks
from vgtjax import tuning
from vgtjax.estimation import Unknown

TEXT = README.read_text(encoding="utf-8")
NOTEBOOKS = sorted(f"notebooks/{path.name}" for path in (ROOT / "notebooks").glob("*.ipynb"))
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
PLAIN = Unknown(duty_delay=False, duty_hold=False, noise="white", loss="gaussian", numerics=False)
"""A search for the parameters only, in a tenth of the time."""


def run(text: str) -> dict:
    """The names of a Python block after it has run."""
    scope: dict = {}
    exec(text, scope)
    return scope


@pytest.fixture(autouse=True)
def _at_home(monkeypatch):
    """Blocks run in a clone, whose session is configured already."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(vgtjax, "configure", lambda: None)


def test_it_fits_on_a_page():
    assert TEXT.count("\n") <= 130


def test_a_campaign_is_calibrated(monkeypatch):
    fit, asked = vgtjax.fit, {}

    def briefly(model, traces, validate):
        """The same fit of two parameters to the begin of a step; that of all by the command is the main job."""
        asked.update(fitted=traces, validate=validate)
        # These two are found in two steps; a window in motion with free friction takes forty.
        free = ["diaphragm.stiffness", "diaphragm.preload"]
        return fit(model, [traces[1].window(0.0, 0.6)], free=free, unknown=PLAIN)

    monkeypatch.setattr(vgtjax, "fit", briefly)
    scope = run(python_block("README.md", "vgtjax.fit"))
    assert scope["found"].converged
    assert [trace.name for trace in asked["validate"]] == ["levels_2"]
    assert len(asked["fitted"]) == 5


def test_a_series_is_studied():
    scope = run(python_block("README.md", "spread_population"))
    assert scope["width"].shape == (256,)
    assert not scope["results"].failed.any()


def test_a_controller_is_tuned(monkeypatch):
    asked = {}
    # What `tune` makes of such a call is seen by tests/vgtjax/tuning/test_manual.py, which runs the manual's own.
    monkeypatch.setattr(
        tuning, "tune", lambda *given: asked.update(zip(("controller", "cases", "objective"), given, strict=True))
    )
    run(python_block("README.md", "tune("))
    assert tuning.gain_names(asked["controller"]) == ["proportional_gain", "integral_gain", "tracking_time"]
    assert len(asked["cases"]) == 1
    assert asked["objective"].settled == 0.2


def test_ci_finds_both_commands():
    commands = blocks(README, "bash")
    assert "-m calibrate fit --out out/example" in commands[0]
    assert commands[1].rstrip().endswith("-m pytest")
    for command in commands[:2]:
        assert command.startswith("python3 -m venv .venv && ")
        assert command.count("\n") == 1  # .ci/run takes one line


@pytest.mark.parametrize("target", re.findall(r"\]\((?!http)([^)#]+)\)", TEXT))
def test_links_lead_somewhere(target):
    assert (ROOT / target).exists()


def test_the_example_is_small():
    # Beside the 5 MB of the plot library that every report carries; the loops of twenty units are a third of it.
    assert sum(file.stat().st_size for file in EXAMPLE.rglob("*.csv")) < 4e6


CALLED_MEASURED = re.compile(
    r"real (bench|traces|residuals)|bench unit|measured (units|loops|actuator)|noise of the\W+bench"
)


@pytest.mark.parametrize("path", ["README.md", "CONTRIBUTING.md", *PAGES, *NOTEBOOKS])
def test_what_ships_is_not_called_measured(path):
    assert not CALLED_MEASURED.search((ROOT / path).read_text(encoding="utf-8"))


@pytest.mark.parametrize("folder", ["vgtjax", "calibrate", "tests"])
def test_nor_do_docstrings_templates_and_studies(folder):
    own = pathlib.Path(__file__).resolve()
    files = [file for kind in ("py", "jinja", "toml") for file in (ROOT / folder).rglob(f"*.{kind}") if file != own]
    assert files
    assert [file for file in files if CALLED_MEASURED.search(file.read_text(encoding="utf-8"))] == []


def test_readme_says_that_all_traces_are_simulated():
    assert "nothing that ships was measured" in TEXT
