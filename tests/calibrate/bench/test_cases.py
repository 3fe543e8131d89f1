"""Benchmarks by their names on the command line."""

import ast
import importlib.util
import pathlib

import pytest

from calibrate.bench import cases
from calibrate.bench.__main__ import _CASES


@pytest.mark.parametrize("name", _CASES)
def test_every_name_has_a_function(name):
    """Read and not imported: the opponents that a benchmark imports may be missing here."""
    spec = importlib.util.find_spec(f"{cases.__name__}.{cases.module_of(name)}")
    assert spec is not None
    tree = ast.parse(pathlib.Path(spec.origin).read_text(encoding="utf-8"))
    assert "measure" in {each.name for each in tree.body if isinstance(each, ast.FunctionDef)}


def test_a_name_finds_its_benchmark():
    assert cases.find_case("unknown-plants").__module__ == f"{cases.__name__}.unknown_plants"
