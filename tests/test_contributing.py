"""CONTRIBUTING's tables lead to every equation: their files, functions and tests exist."""

import ast
import pathlib
import re

import pytest

from calibrate.manual.contributing import ROOT, numbers_in, table

EQUATIONS, ERRATA = table("equation"), table("erratum of the print")


def references(cell: str) -> list[tuple[str, str]]:
    """Files of a cell, each with a name in it or an empty one; a name without a file belongs to the file before it."""
    found, file = [], ""
    for quoted in re.findall(r"`([^`]+)`", cell):
        head, _, name = (part.strip() for part in quoted.partition(":"))
        file, name = (head, name) if head.endswith(".py") else (file, head)
        found.append((file, name))
    return found


def names_defined(path: pathlib.Path) -> set[str]:
    """Every function, method and class of a file."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}


def problem_of_code(file: str, name: str) -> str:
    """What is wrong with a reference to the library, or nothing."""
    path = ROOT / "vgtjax" / file
    if not path.is_file():
        return f"vgtjax/{file} does not exist"
    if name and name not in names_defined(path):
        return f"vgtjax/{file} defines no {name}"
    return ""


def problem_of_test(file: str, beginning: str) -> str:
    """What is wrong with a reference to a test, wherever below `tests` its file is, or nothing."""
    paths = list((ROOT / "tests").rglob(file)) if file else []
    if len(paths) != 1:
        return f"there are {len(paths)} tests/**/{file}"
    if not any(name.startswith(beginning.removesuffix("...")) for name in names_defined(paths[0])):
        return f"{file} has no {beginning}"
    return ""


def test_every_number_stands_by_itself():
    """A search for one finds none inside of a range."""
    assert [row[0] for row in EQUATIONS if re.search(r"\d\s*[-\u2013]\s*\d", row[0])] == []
    listed = [numbers_in(row[0]) for row in EQUATIONS if not row[0].startswith("section")]
    assert all(len(set(numbers)) == len(numbers) for numbers in listed)


def test_both_tables_are_read():
    assert len(EQUATIONS) > 100
    assert {len(row) for row in EQUATIONS} == {4}
    assert len(ERRATA) > 20
    assert {len(row) for row in ERRATA} == {3}


@pytest.mark.parametrize("row", EQUATIONS, ids=lambda row: row[0])
def test_an_equation_is_where_its_row_says(row):
    _, _, code, tests = row
    assert references(code)
    assert references(tests)
    assert [file for file, name in references(code) if not name] == []
    assert [problem for reference in references(code) if (problem := problem_of_code(*reference))] == []
    assert [problem for reference in references(tests) if (problem := problem_of_test(*reference))] == []


@pytest.mark.parametrize("row", ERRATA, ids=lambda row: row[0])
def test_an_erratum_is_tested_where_its_row_says(row):
    assert references(row[-1])
    assert [problem for reference in references(row[-1]) if (problem := problem_of_test(*reference))] == []


@pytest.mark.parametrize(
    ("problem", "sentence"),
    [
        (problem_of_code("parts/_gone.py", ""), "vgtjax/parts/_gone.py does not exist"),
        (problem_of_code("parts/_air.py", "no_such_flow"), "vgtjax/parts/_air.py defines no no_such_flow"),
        (problem_of_test("test_gone.py", ""), "there are 0 tests/**/test_gone.py"),
        (problem_of_test("test_air.py", "test_no_such..."), "test_air.py has no test_no_such..."),
        (problem_of_test("", "test_of_no_file"), "there are 0 tests/**/"),
    ],
)
def test_a_dead_row_is_found(problem, sentence):
    assert problem == sentence
