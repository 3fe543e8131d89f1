"""From the names in a study to a model with its start values."""

import math
from typing import Any

import numpy as np

import vgtjax
from vgtjax.errors import InputError
from vgtjax.estimation.calibration import Bounds
from vgtjax.parameters import entry_names, match_entries, unknown_name

from .study import Components, Study

FRICTION = {"lugre": vgtjax.LuGre}
VANE_FORCE = {"none": vgtjax.NoVaneForce}
LINE = {"none": vgtjax.NoLine}
CHAMBER = {"adiabatic": vgtjax.AdiabaticChamber}
MAGNETIC_FORCE = {"static": None}
LATER = {
    "friction": ("coulomb", "karnopp", "dahl"),
    "vane_force": ("polynomial", "map"),
    "line": ("delay", "wave"),
    "chamber": ("wall", "isothermal"),
    "magnetic_force": ("coil",),
}
"""Names that the study format knows and this version does not have yet."""


def _choose(kind: str, name: str, available: dict[str, Any]) -> Any:
    if name in available:
        return available[name]
    if name in LATER[kind]:
        raise InputError(f"{kind} = '{name}' is not available in this version; use {' or '.join(map(repr, available))}")
    raise unknown_name(f"{kind} =", name, [*available, *LATER[kind]])


def build_model(study: Study) -> vgtjax.AbstractModel:
    """The model that a study names, with printed parameters.

    **Raises:** `InputError` for a model or component that is unknown or not available.
    """
    chosen: Components = study.components
    friction = _choose("friction", chosen.friction, FRICTION)()
    vane_force = _choose("vane_force", chosen.vane_force, VANE_FORCE)()
    line = _choose("line", chosen.line, LINE)()
    chamber = _choose("chamber", chosen.chamber, CHAMBER)()
    _choose("magnetic_force", chosen.magnetic_force, MAGNETIC_FORCE)
    match study.model:
        case "full":
            return vgtjax.Actuator(friction=friction, vane_force=vane_force, line=line, chamber=chamber)
        case "mechanical":
            return vgtjax.MechanicalActuator(friction=friction, vane_force=vane_force)
    raise InputError(f"model = '{study.model}' is not available in this version; use 'full' or 'mechanical'")


def start_values(model: vgtjax.AbstractModel, study: Study) -> tuple[dict[str, Any], Bounds]:
    """Start values by name and bounds by entry from the study's `[parameters]`.

    **Raises:** `InputError` for an unknown name, a wrong number of values, or a value that is not physical.
    """
    values: dict[str, Any] = {}
    bounds: Bounds = {}
    for name, given in study.parameters.items():
        entries = _entries_of(model, name)
        for key in ("value", "lower", "upper"):
            _check_length(name, key, getattr(given, key), entries)
        for position, entry in enumerate(entries):
            low, high = _bound(given.lower, position), _bound(given.upper, position)
            if low is not None and high is not None and not low < high:
                raise InputError(f"the bounds of '{entry}' must rise, but they are {low:g} and {high:g}; swap them")
            bounds[entry] = (low, high)
        if given.value is not None:
            values |= _merge(model, values, name, given.value)
    for name, value in values.items():
        check_value(model, name, value)
    return values, bounds


def _entries_of(model: vgtjax.AbstractModel, name: str) -> list[str]:
    table = vgtjax.parameter_table(model)
    if any(letter in name for letter in "*?"):
        raise InputError(f"[parameters] takes names, not patterns, but it has '{name}'; write one line a parameter")
    found = match_entries(table, [name])
    return [entry for entry in entry_names(table) if entry in found]


def _check_length(name: str, key: str, value: float | list[float] | None, entries: list[str]) -> None:
    if value is None:
        return
    if entries == [name] and isinstance(value, list):
        raise InputError(f"'{name}' needs one number under {key}, but it has a list; give one number")
    length = len(value) if isinstance(value, list) else 1
    if length != len(entries):
        raise InputError(
            f"'{name}' needs {len(entries)} numbers under {key}, but it has {length}; give a list of {len(entries)}"
        )


def _bound(values: float | list[float] | None, position: int) -> float | None:
    """One bound; an infinite one is none."""
    bound = values[position] if isinstance(values, list) else values
    return None if bound is None or math.isinf(bound) else bound


def _merge(model: vgtjax.AbstractModel, values: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    """A value for a whole parameter, or for one entry of a vector."""
    if not name.endswith("]"):
        return {name: value}
    base, index = name[:-1].split("[")
    vector = np.array(values.get(base, vgtjax.get_parameter(model, base)))
    vector[int(index)] = value
    return {base: vector.tolist()}


def check_value(model: vgtjax.AbstractModel, name: str, value: Any) -> None:
    """Whether a value may stand for a parameter.

    **Raises:** `InputError` otherwise.
    """
    row = vgtjax.parameter_table(model)[name]
    _check_length(name, "value", value, entry_names({name: row}))
    numbers = value if isinstance(value, list) else [value]
    infinite = name == "diaphragm.travel"
    for number in numbers:
        if math.isnan(number) or (math.isinf(number) and not infinite) or (row.positive and number < 0):
            rule = "finite and not negative" if row.positive else "finite"
            raise InputError(f"'{name}' must be {rule}, but it is {number:g}; correct it")


def check_bounds(model: vgtjax.AbstractModel, bounds: Bounds) -> None:
    """Whether the values of a model, free and held, keep to their bounds.

    **Raises:** `InputError` for the first that does not.
    """
    selection = vgtjax.select(model, free=list(bounds))
    for entry, value in zip(selection.entries, selection.pack(model).tolist(), strict=True):
        low, high = bounds[entry]
        if low is not None and not low <= value:
            raise InputError(f"'{entry}' must be at least {low:g}, but it is {value:g}; change one under [parameters]")
        if high is not None and not value <= high:
            raise InputError(f"'{entry}' must be at most {high:g}, but it is {value:g}; change one under [parameters]")
