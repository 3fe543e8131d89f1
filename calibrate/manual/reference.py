"""Tables that the code itself writes: options of commands, keys of studies, parameters, channels, words."""

import functools
import importlib
import inspect
import typing
from collections.abc import Iterable
from typing import Any

import click
import equinox as eqx
import griffe
import numpy as np
import pydantic

import vgtjax
from calibrate.command_line import main
from calibrate.study import (
    channels as channel_tables,
    components,
    control as control_tables,
    disturbances,
    loop_disturbances,
    references,
    tables,
)
from calibrate.tune.designs import DESIGNS

from .contributing import table

ROOMS = (
    *("parameters", "traces", "turbine", "parts", "plants", "simulation", "exhaust", "experiments"),
    *("estimation", "identification", "assurance", "population", "sensitivity", "control", "tuning"),
)
"""The rooms of the library, in the order in which data flow."""
TABLES = (tables, control_tables, disturbances, loop_disturbances, references, channel_tables, components)
"""Where the classes of a study's tables are."""
PARTS: dict[str, dict[Any, Any]] = {
    "friction": components.FRICTION,
    "vane_force": components.VANE_FORCE,
    "line": components.LINE,
    "magnetic_force": components.MAGNETIC_FORCE,
    "chamber": components.CHAMBER,
}
"""Variants of each component, the default first."""


def as_table(heading: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [list(heading), *map(list, rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def options(command: str) -> str:
    """What a command takes, as its help says it."""
    found = main.commands[command]
    rows = [(_synopsis(each), _meaning(each)) for each in found.params]
    return as_table(("argument or option", "meaning"), rows)


def _synopsis(option: click.Parameter) -> str:
    if isinstance(option, click.Argument):
        return f"`{option.name.upper()}`" + ("" if option.required else ", may be left out")
    choice = option.type.choices if isinstance(option.type, click.Choice) else ()
    value = option.metavar or "\\|".join(choice) or option.type.name.upper()
    return f"`{option.opts[0]} {value}`".replace("\\", "") + (", required" if option.required else "")


def _meaning(option: click.Parameter) -> str:
    if isinstance(option, click.Option):
        default = f" Default: {option.default}." if option.show_default else ""
        return (option.help or "") + default
    return {"study": "A study file.", "results": "A folder or a file of results."}[option.name or ""]


def keys(name: str) -> str:
    """The keys of a study's table, by the name of its class."""
    model = next(getattr(module, name) for module in TABLES if hasattr(module, name))
    texts = _attributes(model)
    rows = []
    for key, field in model.model_fields.items():
        if key == "model" or not _is_table(field.annotation):
            rows.append((f"`{key}`", _kind(field.annotation, field.metadata), _default(field), texts.get(key, "")))
    return as_table(("key", "what", "default", "meaning"), rows)


def _attributes(model: type) -> dict[str, str]:
    """What stands below the fields of a class and of those that it is made from."""
    found: dict[str, str] = {}
    for each in reversed(model.__mro__):
        if each.__module__.startswith("calibrate."):
            members = _package("calibrate")[each.__module__.removeprefix("calibrate.")][each.__name__].members
            texts = {key: member.docstring.value for key, member in members.items() if member.docstring}
            found |= {key: " ".join(text.split()) for key, text in texts.items()}
    return found


@functools.cache
def _package(name: str) -> griffe.Object:
    return typing.cast(griffe.Object, griffe.load(name))


def _is_table(kind: Any) -> bool:
    """Whether a key is a table of its own, which has a section of its own."""
    inside = [kind, *typing.get_args(kind)]
    return any(inspect.isclass(each) and issubclass(each, pydantic.BaseModel) for each in inside)


def _kind(kind: Any, metadata: Iterable[Any] = ()) -> str:
    """A type as a reader of TOML has it, with the ends of its numbers."""
    inner = [each for each in typing.get_args(kind) if each is not type(None)]
    origin = typing.get_origin(kind)
    if origin is typing.Annotated:
        return _kind(inner[0], kind.__metadata__)
    if origin is typing.Literal:
        return ", ".join(f'`"{each}"`' if isinstance(each, str) else f"`{str(each).lower()}`" for each in inner)
    if origin is list:
        return f"list of {_kind(inner[0])}"
    if origin in (dict, tuple):
        return "table" if origin is dict else "two numbers"
    if inner:
        return ", ".join(dict.fromkeys(_kind(each) for each in inner))
    name = {str: "text", float: "number", int: "whole number", bool: "`true`, `false`"}.get(kind, "table")
    return " ".join([name, *_ends(metadata)])


def _ends(metadata: Iterable[Any]) -> list[str]:
    """The least and the largest number that annotations allow."""
    constraints = [inside for each in metadata for inside in getattr(each, "metadata", [each])]
    words = (("ge", "from"), ("gt", "above"), ("le", "to"), ("lt", "below"))
    return [f"{word} {getattr(each, end):g}" for end, word in words for each in constraints if hasattr(each, end)]


def _default(field: pydantic.fields.FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if value is None or value in ([], {}):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, list) and not isinstance(value[0], float | int | str):
        return ""
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def parameters() -> str:
    """Every parameter of the full model and of its variants: name, symbol, unit, printed value, source."""
    rows: dict[tuple[str, str], tuple[str, ...]] = {}
    having: dict[tuple[str, str], list[str]] = {}
    for component, model in _models():
        for name, row in vgtjax.parameter_table(model).items():
            value = vgtjax.get_parameter(model, name)
            rows.setdefault((name, row.symbol), (f"`{name}`", *_described(row, value)))
            having.setdefault((name, row.symbol), []).append(component)
    # What the actuator itself has comes first, with no component to name.
    cells = (
        (*row, "" if "" in having[key] else ", ".join(f"`{each}`" for each in having[key])) for key, row in rows.items()
    )
    return as_table(("name", "symbol", "unit", "value", "source", "held by default", "only with"), cells)


def _models() -> Iterable[tuple[str, Any]]:
    """The actuator, and one with each other variant of a component, with what a study says for it."""
    yield "", vgtjax.Actuator()
    for field, variants in PARTS.items():
        for name in list(variants)[1:]:
            chosen = components.FullComponents(**{field: name})  # type: ignore[arg-type]
            # Inside of `jit` no table of forces is made, which takes long.
            yield f'{field} = "{name}"', eqx.filter_jit(chosen.build)()


def _described(row: vgtjax.Parameter, value: Any) -> tuple[str, ...]:
    """With the value that the model has, which need not be its class's own."""
    values = np.ravel(value).tolist()
    units = (row.unit,) if isinstance(row.unit, str) else row.unit
    shown = ", ".join(f"{value:.6g}" for value in values[:5]) + (", ..." if len(values) > 5 else "")
    return row.symbol, ", ".join(units[:5]), shown, row.source, "yes" if row.held else ""


def channels() -> str:
    """The signals that a trace may have."""
    signals, units = vgtjax.traces.SIGNALS, vgtjax.traces.UNITS
    rows = [("`time`", "when a row was sampled, from any beginning", _quoted(units["time"]))]
    for name in units:
        if name in signals:
            rows.append((f"`{name}`", signals[name].meaning, _quoted(units[name])))
    return as_table(("column", "meaning", "units"), rows)


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def designs() -> str:
    """The controllers that a study can name."""
    rows = (
        (f"`{name}`", f"[`{each.__name__}`](api/control.md#vgtjax.control.{each.__name__})")
        for name, each in DESIGNS.items()
    )
    return as_table(("design", "class"), rows)


def words() -> str:
    """CONTRIBUTING's words."""
    return as_table(("word", "meaning"), table("word"))


def api(room: str) -> str:
    """A documentation block for everything public in a room of the library."""
    module = importlib.import_module(f"vgtjax.{room}" if room else "vgtjax")
    return "\n\n".join(f"::: {module.__name__}.{name}" for name in public_names(room))


def public_names(room: str) -> list[str]:
    """What a room offers, or, with an empty name, what the library itself offers beside its rooms' contents."""
    module = importlib.import_module(f"vgtjax.{room}" if room else "vgtjax")
    names = [name for name, value in vars(module).items() if name[0] != "_" and not inspect.ismodule(value)]
    if not room:
        inside = {name for each in ROOMS for name in public_names(each)}
        names = [name for name in names if name not in inside]
    return sorted(names, key=str.lower)
