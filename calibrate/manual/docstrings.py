"""Docstrings as the site shows them: with the table of parameters, and with references that lead somewhere.

Classes write their parameters into their documentation when they are made, which reading the source does not see. And
a docstring refers to a neighbour by its bare name, as it is imported.
"""

import importlib
import re
from typing import Any

import griffe

from calibrate.manual.reference import ROOMS, as_table, public_names
from vgtjax.parameters import Parameter

REFERENCE = re.compile(r"\[(`[^`\]]+`)\]\[\]")
ROW = "parameter"


class Extension(griffe.Extension):
    """Loaded by mkdocstrings, see `zensical.toml`."""

    def __init__(self) -> None:
        self._places = {name: f"vgtjax.{room}.{name}" for room in ROOMS for name in public_names(room)}
        self._places |= {name: f"vgtjax.{name}" for name in public_names("")}

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Docstrings of every kind of object."""
        if obj.docstring:
            obj.docstring.value = REFERENCE.sub(self._lead, obj.docstring.value)

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """The parameters of a class, with unit, symbol and source."""
        rows = parameters_of(cls.path) if cls.docstring else []
        if rows and cls.docstring:
            heading = ("parameter", "symbol", "unit", "value", "source")
            cls.docstring.value += f"\n\n**Parameters:**\n\n{as_table(heading, rows)}"

    def _lead(self, match: re.Match[str]) -> str:
        """A reference to a public name leads there; another name is only shown."""
        first, _, rest = match[1].strip("`").partition(".")
        if first not in self._places:
            return match[1]
        return f"[{match[1]}][{self._places[first]}{'.' * bool(rest)}{rest}]"


def parameters_of(path: str) -> list[tuple[str, ...]]:
    """A row for each parameter that a class declares itself."""
    module, _, name = path.rpartition(".")
    try:
        cls = getattr(importlib.import_module(module), name)
    except (AttributeError, ImportError):  # a class in a class has no parameters
        return []
    fields = {
        key: value
        for key, value in vars(cls).get("__dataclass_fields__", {}).items()
        if key in vars(cls).get("__annotations__", {})
    }
    return [_shown(key, field.metadata[ROW]) for key, field in fields.items() if ROW in field.metadata]


def _shown(name: str, row: Parameter) -> tuple[str, ...]:
    unit = row.unit if isinstance(row.unit, str) else ", ".join(row.unit)
    value = (
        f"{row.default:.6g}"
        if isinstance(row.default, float | int)
        else ", ".join(f"{each:.6g}" for each in row.default)
    )
    marks = [row.source, *(["assumed"] * (row.assumed and "assumed" not in row.source)), *(["held"] * row.held)]
    return f"`{name}`", row.symbol, unit, value, ", ".join(marks)
