"""The benchmarks, one file each; every one returns a table."""

import importlib
from collections.abc import Callable

from ..table import Section

_ELSEWHERE = {"population": ("population", "measure_population"), "memory": ("population", "measure_memory")}
"""Module and function where they are not `measure` of the module that is named like the benchmark."""


def find_case(name: str) -> Callable[..., Section]:
    """A benchmark by its name on the command line; only what it needs itself is imported, opponents too."""
    module, function = place_of(name)
    return getattr(importlib.import_module(f".{module}", __package__), function)


def place_of(name: str) -> tuple[str, str]:
    """Its module and its function."""
    return _ELSEWHERE.get(name, (name.replace("-", "_"), "measure"))
