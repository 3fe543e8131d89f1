"""The benchmarks, one file each; every one returns a table."""

import importlib
from collections.abc import Callable

from ..table import Section


def find_case(name: str) -> Callable[..., Section]:
    """A benchmark by its name on the command line; only what it needs itself is imported, opponents too."""
    return importlib.import_module(f".{module_of(name)}", __package__).measure


def module_of(name: str) -> str:
    """The module of a benchmark, whose `measure` it is."""
    return name.replace("-", "_")
