"""Tables that the code makes stand in the pages as it makes them."""

import re

import pytest
from markdown_pages import DOCS, ROOT

pytest.importorskip("griffe", reason="the extra docs is not installed")

import vgtjax
from calibrate.manual import reference, tables

PAGES = tables.pages()
AGAIN = "python -m calibrate.manual.tables writes it anew"


@pytest.mark.parametrize(
    "page", [page for page in PAGES if tables.PLACE.search(PAGES[page])], ids=lambda path: path.stem
)
def test_tables_are_current(page):
    assert tables.current(PAGES[page]) == PAGES[page], AGAIN


def test_each_kind_of_table_stands_somewhere_and_no_other_does():
    asked = {name for text in PAGES.values() for name in re.findall(r"<!-- (\w+)\(", text)}
    assert asked == set(tables.MADE)
    ends = sum(text.count("<!-- end -->") for text in PAGES.values())
    assert ends == sum(len(tables.PLACE.findall(text)) for text in PAGES.values())


def test_a_stale_table_is_seen():
    text = PAGES[DOCS / "commands" / "fit.md"]
    assert tables.current(text.replace("`--out DIR`", "`--into DIR`")) == text


def test_parameters_have_the_values_that_a_model_is_built_with():
    """The wheel loses more than what the class of its loss has by default."""
    nozzle = vgtjax.turbine.Nozzle()
    lines = [line.strip("| ").split(" | ") for line in reference.parameters().splitlines()[2:]]
    shown = {name.strip("`"): value for name, _, _, value, *_ in lines}
    for name in vgtjax.parameter_table(nozzle):  # six digits are shown
        assert float(shown[f"vane_force.nozzle.{name}"]) == pytest.approx(float(vgtjax.get_parameter(nozzle, name)))
    assert shown["vane_force.nozzle.rotor.zeta"] != shown["vane_force.nozzle.vanes.zeta"]


def test_only_the_api_is_left_to_the_sites_builder():
    asked = {path.parent.name for path, text in PAGES.items() if "{{" in text}
    assert asked == {"api"}
    assert "{{" not in (ROOT / "README.md").read_text(encoding="utf-8")
