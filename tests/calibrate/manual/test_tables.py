"""Tables that the code makes stand in the pages as it makes them."""

import inspect
import re
import typing

import pydantic
import pytest
from markdown_pages import DOCS, ROOT

pytest.importorskip("griffe", reason="the extra docs is not installed")

import vgtjax
from calibrate.manual import reference, tables
from calibrate.study.tables import STUDIES, FullStudy, Study

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


def tables_in(kind) -> set[type]:
    """Every class of a table in an annotation, and in those of its keys."""
    if inspect.isclass(kind) and issubclass(kind, pydantic.BaseModel):
        fields = kind.model_fields.values()
        return {kind}.union(*(tables_in(field.annotation) for field in fields))
    return set().union(*map(tables_in, typing.get_args(kind)))


def test_every_table_of_a_study_is_on_its_page():
    text = PAGES[DOCS / "study_file.md"]
    schema = set().union(*map(tables_in, STUDIES))
    assert len(schema) > 30
    shown = set(re.findall(r'<!-- keys\("(\w+)"\) -->', text))
    # The studies of the other models have the same tables, and a name of their own under `model`.
    assert {each.__name__ for each in schema if not issubclass(each, Study) or each is FullStudy} == shown
    assert {tuple(each.model_fields) for each in STUDIES} == {tuple(FullStudy.model_fields)}


def without_meaning(text: str) -> list[str]:
    """The first cells of rows that lack one, in tables that the code makes."""
    empty = []
    for match in tables.PLACE.finditer(text):
        rows = [line.strip("| ").split(" | ") for line in match[0].splitlines() if line.startswith("|")]
        column = rows[0].index("meaning") if rows and "meaning" in rows[0] else -1
        empty += [row[0] for row in rows[2:] if column >= 0 and not "".join(row[column : column + 1]).strip()]
    return empty


@pytest.mark.parametrize("page", [page for page in PAGES if "<!-- " in PAGES[page]], ids=lambda path: path.stem)
def test_every_key_and_option_has_a_meaning(page):
    assert without_meaning(PAGES[page]) == []


def test_a_missing_meaning_is_seen():
    text = PAGES[DOCS / "study_file.md"].replace("| The headline. |", "|  |")
    text = text.replace("| `offset` | number | `0.0` | In `unit`. |", "| `offset` | number | `0.0` | |")
    assert without_meaning(text) == ["`offset`", "`title`"]
    text = PAGES[DOCS / "files.md"].replace("when a row was sampled, from any beginning", "")
    assert without_meaning(text) == ["`time`"]
