"""From a study to a model with its start values."""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import numpy as np

import vgtjax
from vgtjax import estimation
from vgtjax.parameters import Bounds, Scale, check_bounds, entry_names, match_entries, select
from vgtjax.plants import on_given_knots, require_physical

from ..output.console import console
from .base import ParameterValue, StartValue
from .components import FullComponents, MechanicalComponents, ReducedComponents
from .places import StudyError
from .tables import Study

S = TypeVar("S", bound=StartValue)
"""What a study states of a parameter."""


def build_model(study: Study) -> vgtjax.AbstractModel:
    """The model that a study names, with printed parameters and its tables on the knots that the study states.

    A flow map is fitted to the converter and the air that the study states.
    """
    match study.components:
        case FullComponents() | MechanicalComponents() as parts:
            model: vgtjax.AbstractModel = parts.build()
        case ReducedComponents() as parts:
            stated = {n: given for n, given in study.parameters.items() if n.startswith(("converter.", "air."))}
            full = parts.full()
            model = parts.reduce(vgtjax.replace_parameters(full, start_values(full, stated)[0]))
    return on_given_knots(model, {name: given.value for name, given in study.parameters.items()})


def start_model(model: Any, study: Study, earlier: dict[str, Any]) -> tuple[Any, Bounds]:
    """A study's model with the values that it starts from, and their bounds by entry.

    **Arguments:** `earlier`: values of an earlier fit, by name. What the study states of a parameter that it holds goes
    before them; of one that it frees that is where a fit begins, and goes behind.
    """
    start = vgtjax.replace_parameters(on_given_knots(model, earlier), earlier)
    start = _on_stated_knots(start, study, _free(model, study) if earlier else set())
    stated, bounds = start_values(start, _stated_before(start, study, earlier))
    start = vgtjax.replace_parameters(start, stated)
    check_bounds(start, bounds)
    require_physical(start)
    return start, bounds


def _on_stated_knots(start: Any, study: Study, free: Collection[str]) -> Any:
    """The start with its tables read at the knots that the study states, but for those that are free."""
    moved = {entry.partition("[")[0] for entry in free}
    stated = {
        name: given.value
        for name, given in parameters_of(study).items()
        if given.value is not None and name.partition("[")[0] not in moved
    }
    values: dict[str, Any] = {name: value for name, value in stated.items() if not name.endswith("]")}
    sized = on_given_knots(start, values)
    for name in (name for name in stated if name.endswith("]")):
        check_length(name, "value", stated[name], _entries_of(sized, name))
        values |= merge(sized, values, name, stated[name])
    return on_given_knots(start, values)


def _free(model: eqx.Module, study: Study) -> set[str]:
    return set(select(model, study.fit.free, study.fit.fixed).entries)


def _stated_before(start: eqx.Module, study: Study, earlier: Mapping[str, Any]) -> dict[str, ParameterValue]:
    """What a study states, with the values of free entries as the start has them where an earlier fit has these."""
    if not earlier:
        return parameters_of(study)
    free = _free(start, study)
    return {name: _behind(start, name, given, free, earlier) for name, given in parameters_of(study).items()}


def _behind(start: Any, name: str, given: ParameterValue, free: set[str], earlier: Mapping[str, Any]) -> ParameterValue:
    entries = _entries_of(start, name)
    check_length(name, "value", given.value, entries)
    if given.value is None or name.partition("[")[0] not in earlier or not free.intersection(entries):
        return given
    found = vgtjax.Selection(tuple(entries)).values(start).tolist()
    stated = np.ravel(given.value).tolist()
    value = [mine if entry in free else held for entry, mine, held in zip(entries, found, stated, strict=True)]
    return given.model_copy(update={"value": value if isinstance(given.value, list) else value[0]})


def say_not_as_stated(start: eqx.Module, study: Study, began: Mapping[str, Any]) -> None:
    """Says of which parameters a start has not the value that the study states, as an earlier fit has another.

    **Arguments:** `began`: where that fit began, by name: of what is stated as that nothing needs to be said.
    """
    other = []
    for name, given in parameters_of(study).items():
        here = vgtjax.Selection(tuple(_entries_of(start, name))).values(start)
        same = (np.ravel(each) for each in (here, _initial(began, name)))
        if given.value is not None and not any(np.array_equal(each, np.ravel(given.value)) for each in same):
            other.append(name)
    if other:
        console.print(
            f"note: {', '.join(other)}: as in the given parameters; what the study states of free ones only says where "
            "a fit begins"
        )


def _initial(began: Mapping[str, Any], name: str) -> Any:
    """Where a fit began with a parameter, or with one entry of it."""
    base, _, index = name.removesuffix("]").partition("[")
    whole = began.get(base)
    return whole[int(index)] if index and isinstance(whole, list) and int(index) < len(whole) else whole


def parameters_of(study: Study) -> dict[str, ParameterValue]:
    """What a study states of its model, without what only shapes a flow map."""
    if study.model != "static-map":
        return study.parameters
    for name, given in study.parameters.items():
        if name.startswith("converter.") and (given.lower is not None or given.upper is not None):
            raise StudyError(
                f"'{name}' only shapes the flow map of model = 'static-map', so it has a value and no bounds; remove "
                "them"
            )
    return {name: given for name, given in study.parameters.items() if not name.startswith("converter.")}


def values_of(model: eqx.Module) -> dict[str, Any]:
    """Every parameter of a model by name, a list for a vector."""
    return {name: np.asarray(vgtjax.get_parameter(model, name)).tolist() for name in vgtjax.parameter_table(model)}


def start_values(model: eqx.Module, stated: Mapping[str, StartValue]) -> tuple[dict[str, Any], Bounds]:
    """Start values by name and bounds by entry, of a model or a controller."""
    values: dict[str, Any] = {}
    bounds: Bounds = {}
    for name, given in vectors_first(stated):
        entries = _entries_of(model, name)
        for key in ("value", "lower", "upper"):
            check_length(name, key, getattr(given, key), entries)
        for position, entry in enumerate(entries):
            low, high = _bound(entry, "lower", given.lower, position), _bound(entry, "upper", given.upper, position)
            before = bounds.get(entry, (None, None))
            low, high = before[0] if low is None else low, before[1] if high is None else high
            if low is not None and high is not None and not low < high:
                raise StudyError(
                    f"the bounds of '{entry}' must rise, but they are {low:g} and {high:g}; correct them", "bounds"
                )
            bounds[entry] = (low, high)
        if given.value is not None:
            values |= merge(model, values, name, given.value)
    on_given_knots(model, values)  # knots must still increase where one of them is stated by itself
    return values, bounds


class Known(NamedTuple):
    """What a study knows of values beforehand, by entry in the units of the table: how well, and what they are."""

    deviations: dict[str, float]
    centers: dict[str, float]


def known_beforehand(model: eqx.Module, stated: Mapping[str, ParameterValue]) -> Known:
    """What is known beforehand, of values that are stated, or else are those of the model."""
    values: dict[str, float] = {}
    ways: dict[str, ParameterValue] = {}
    for name, given in vectors_first(stated):
        entries = _entries_of(model, name)
        if given.value is not None:
            values |= dict(zip(entries, np.ravel(given.value).tolist(), strict=True))
        if given.deviation is not None or given.relative is not None:
            ways |= dict.fromkeys(entries, given)
    here = dict(zip(ways, vgtjax.Selection(tuple(ways)).values(model).tolist(), strict=True)) if ways else {}
    known = Known({}, {})
    for entry, given in ways.items():
        value = values.get(entry, here[entry])
        deviation = given.deviation if given.deviation is not None else (given.relative or 0.0) * abs(value)
        if not deviation > 0:
            raise StudyError(
                f"the deviation of '{entry}' relative to its value must be positive, but that is {value:g}; state it "
                "in the unit of the parameter with deviation",
                "values",
            )
        known.deviations[entry], known.centers[entry] = deviation, value
    return known


def scales_of(model: eqx.Module, stated: Mapping[str, ParameterValue]) -> dict[str, Scale]:
    """How a fit moves those entries of which the study says it."""
    return {
        entry: given.scale
        for name, given in vectors_first(stated)
        if given.scale is not None
        for entry in _entries_of(model, name)
    }


def vectors_first(stated: Mapping[str, S]) -> list[tuple[str, S]]:
    """What is stated by name, of vectors before their entries: what is said of one entry counts, wherever it stands."""
    return sorted(stated.items(), key=lambda each: "[" in each[0])


def _entries_of(model: eqx.Module, name: str) -> list[str]:
    table = vgtjax.parameter_table(model)
    if any(letter in name for letter in "*?"):
        raise StudyError(
            f"start values and bounds have names, not patterns, but there is '{name}'; write one line per parameter",
            "values",
        )
    found = match_entries(table, [name], "values")
    return [entry for entry in entry_names(table) if entry in found]


def check_length(name: str, key: str, value: float | list[float] | None, entries: list[str]) -> None:
    """Refuses more or fewer numbers than a parameter has entries."""
    if value is None:
        return
    if entries == [name] and isinstance(value, list):
        raise StudyError(f"'{name}' needs one number under {key}, but it has a list; give one number", "values")
    length = len(value) if isinstance(value, list) else 1
    if length != len(entries):
        raise StudyError(
            f"'{name}' needs {len(entries)} numbers under {key}, but it has {length}; give a list of {len(entries)}",
            "values",
        )


def _bound(entry: str, key: str, values: float | list[float] | None, position: int) -> float | None:
    """One bound; one that lies infinitely far away is none."""
    bound = values[position] if isinstance(values, list) else values
    if bound is None or bound == (-math.inf if key == "lower" else math.inf):
        return None
    if not math.isfinite(bound):
        raise StudyError(
            f"the {key} bound of '{entry}' must leave it values, but it is {bound:g}; leave it out", "bounds"
        )
    return bound


def merge(model: eqx.Module, values: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    """A value for a whole parameter, or for one entry of a vector."""
    if not name.endswith("]"):
        return {name: value}
    base, index = name[:-1].split("[")
    vector = np.array(values.get(base, vgtjax.get_parameter(model, base)))
    vector[int(index)] = value
    return {base: vector.tolist()}


def passivity_note(model: Any) -> str | None:
    """A sentence where the friction of a model could give out energy, or `None`."""
    if model.friction.is_passive:
        return None
    missing = -float(model.friction.passivity_margin())
    return (
        f"friction is not passive: friction.viscous_damping must be {missing:.4g} N s/m larger for it never to "
        "give out energy; friction = 'lugre-passive' holds a fit to that"
    )


def taken_for_exact(task: estimation.Task) -> list[str]:
    """A sentence on each thing that errors take for exact, and where a study says how well that is known."""
    return estimation.taken_for_exact(
        task, deviations="relative under [parameters]", gains="relative_uncertainty under [[report.sensor]]"
    )
