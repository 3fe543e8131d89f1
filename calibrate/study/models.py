"""From the names in a study to a model with its start values."""

import functools
import math
import operator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax import InputError
from vgtjax.estimation import Bounds
from vgtjax.parameters import entry_names, match_entries, unknown_name

from .tables import Components, Study

FRICTION = {
    "lugre": vgtjax.LuGre,
    "lugre-squared": functools.partial(vgtjax.LuGre, stribeck_exponent=2),
    "lugre-passive": vgtjax.PassiveLuGre,
    "adaptive-lugre": vgtjax.AdaptiveLuGre,
    "dahl": vgtjax.Dahl,
    "karnopp": vgtjax.Karnopp,
    "coulomb": vgtjax.Coulomb,
}
VANE_FORCE = {"none": vgtjax.NoVaneForce, "polynomial": vgtjax.ForcePolynomial, "map": vgtjax.HysteresisMap}
LINE = {"none": vgtjax.NoLine, "delay": vgtjax.DelayLine, "wave": vgtjax.WaveLine}
CHAMBER = {
    "adiabatic": vgtjax.AdiabaticChamber,
    "wall": vgtjax.WallChamber,
    "isothermal": vgtjax.IsothermalChamber,
}
MAGNETIC_FORCE: dict[str, Any] = {
    "static": vgtjax.Converter,
    "coil": lambda: vgtjax.Converter(magnetic_force=vgtjax.Coil()),
}
FLOW_MAP = {
    "plunger-map": {"table": "lift-table"},
    "static-map": {"steady-plunger": "steady-plunger", "polynomial": "polynomial", "printed": "printed"},
}
"""Kinds of [`fit_flow_map`][vgtjax.fit_flow_map] by the names in a study, for both reduced models; the first is the
default."""


def _choose(kind: str, name: str, available: dict[str, Any]) -> Any:
    if name in available:
        return available[name]
    raise unknown_name(f"{kind} =", name, available)


def build_model(study: Study) -> vgtjax.AbstractModel:
    """The model that a study names, with printed parameters; a flow map is fitted to those that the study states.

    **Raises:** `InputError` for a component that is unknown, or that the model does not have.
    """
    chosen: Components = study.components
    if chosen.flow_map is not None and study.model not in FLOW_MAP:
        raise InputError(
            f"flow_map belongs to the models {' and '.join(FLOW_MAP)}, but the study's is '{study.model}'; remove it"
        )
    friction = _choose("friction", chosen.friction, FRICTION)()
    vane_force = _choose("vane_force", chosen.vane_force, VANE_FORCE)()
    line = _choose("line", chosen.line, LINE)()
    chamber = _choose("chamber", chosen.chamber, CHAMBER)()
    converter = _choose("magnetic_force", chosen.magnetic_force, MAGNETIC_FORCE)()
    if study.model == "mechanical":
        return vgtjax.MechanicalActuator(friction=friction, vane_force=vane_force)
    full = vgtjax.Actuator(converter=converter, friction=friction, vane_force=vane_force, line=line, chamber=chamber)
    return full if study.model == "full" else _reduce(full, study)


def _reduce(full: vgtjax.Actuator, study: Study) -> vgtjax.AbstractModel:
    """The reduced model of a study, its flow map fitted to the converter that the study states."""
    chosen, kinds = study.components, FLOW_MAP[study.model]
    for name, only in (("line", "none"), ("chamber", "isothermal")):
        if name in chosen.model_fields_set and getattr(chosen, name) != only:
            raise InputError(
                f"model = '{study.model}' has {name} = '{only}' only, but it is '{getattr(chosen, name)}'; remove it"
            )
    kind = next(iter(kinds.values())) if chosen.flow_map is None else _choose("flow_map", chosen.flow_map, kinds)
    stated = {name: given for name, given in study.parameters.items() if name.startswith(("converter.", "air."))}
    values, _ = start_values(full, study.model_copy(update={"model": "full", "parameters": stated}))
    full = vgtjax.replace_parameters(full, values)
    flow_map: Any = vgtjax.fit_flow_map(full, kind).flow_map
    if study.model == "plunger-map":
        return vgtjax.reduce_to_plunger_map(full, flow_map)
    return vgtjax.reduce_to_static_map(full, flow_map)


def _shapes_the_map(study: Study, name: str) -> bool:
    """Whether a stated parameter is one of the converter that the flow map has replaced.

    **Raises:** `InputError` when it has bounds, which only a parameter of the model may have.
    """
    if study.model != "static-map" or not name.startswith("converter."):
        return False
    if study.parameters[name].lower is not None or study.parameters[name].upper is not None:
        raise InputError(
            f"'{name}' only shapes the flow map of model = 'static-map', so it has a value and no bounds; remove them"
        )
    return True


def on_given_knots(model: vgtjax.AbstractModel, values: dict[str, Any]) -> Any:
    """`model` with its tables at the knots that `values` names, if it does, so that tables of that size fit in.

    **Raises:** `InputError` for knots that don't increase.
    """
    for part in ("vane_force", "friction"):
        component = getattr(model, part, None)
        if not isinstance(component, vgtjax.HysteresisMap | vgtjax.AdaptiveLuGre):
            continue
        given = [values.get(f"{part}.{knots}") for knots in ("turbine_pressure", "crank_angle")]
        if any(isinstance(knots, list) for knots in given):
            old = (component.turbine_pressure, component.crank_angle)
            new = [o if g is None else jnp.asarray(g, float) for o, g in zip(old, given, strict=True)]
            model = eqx.tree_at(operator.attrgetter(part), model, component.on_knots(*new))
    return model


def start_values(model: eqx.Module, study: Study, where: str = "[parameters]") -> tuple[dict[str, Any], Bounds]:
    """Start values by name and bounds by entry from the study's `[parameters]`, which messages call `where`.

    **Raises:** `InputError` for an unknown name, a wrong number of values, or a value that is not physical.
    """
    values: dict[str, Any] = {}
    bounds: Bounds = {}
    for name, given in study.parameters.items():
        if _shapes_the_map(study, name):
            continue
        entries = _entries_of(model, name, where)
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


def _entries_of(model: eqx.Module, name: str, where: str) -> list[str]:
    table = vgtjax.parameter_table(model)
    if any(letter in name for letter in "*?"):
        raise InputError(f"{where} takes names, not patterns, but it has '{name}'; write one line a parameter")
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


def _merge(model: eqx.Module, values: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    """A value for a whole parameter, or for one entry of a vector."""
    if not name.endswith("]"):
        return {name: value}
    base, index = name[:-1].split("[")
    vector = np.array(values.get(base, vgtjax.get_parameter(model, base)))
    vector[int(index)] = value
    return {base: vector.tolist()}


def check_value(model: eqx.Module, name: str, value: Any) -> None:
    """Whether a value may stand for a parameter.

    **Raises:** `InputError` otherwise.
    """
    row = vgtjax.parameter_table(model)[name]
    _check_length(name, "value", value, entry_names({name: row}))
    numbers = value if isinstance(value, list) else [value]
    infinite = name == "diaphragm.travel"
    lowest = 0.0 if row.positive else row.lower
    for number in numbers:
        if math.isnan(number) or (math.isinf(number) and not infinite) or number < lowest:
            rule = "finite" if lowest < 0 else "finite and not negative"
            raise InputError(f"'{name}' must be {rule}, but it is {number:g}; correct it")


def passivity_note(model: Any) -> str | None:
    """A sentence where the friction of a model could give out energy, or `None`."""
    margin = model.friction.passivity_margin()
    if margin is None or margin > 0:
        return None
    return (
        f"friction is not passive: friction.viscous_damping must be {-float(margin):.4g} N s/m larger for it never to "
        "give out energy; friction = 'lugre-passive' holds a fit to that"
    )


def check_bounds(model: eqx.Module, bounds: Bounds, where: str = "[parameters]") -> None:
    """Whether the values of a model, free and held, keep to their bounds; messages call their table `where`.

    **Raises:** `InputError` for the first that does not.
    """
    selection = vgtjax.select(model, free=list(bounds))
    for entry, value in zip(selection.entries, selection.pack(model).tolist(), strict=True):
        low, high = bounds[entry]
        if low is not None and not low <= value:
            raise InputError(f"'{entry}' must be at least {low:g}, but it is {value:g}; change one under {where}")
        if high is not None and not value <= high:
            raise InputError(f"'{entry}' must be at most {high:g}, but it is {value:g}; change one under {where}")
