"""`parameters.json`: what a fit found."""

import dataclasses
import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

import vgtjax
from vgtjax.estimation import Around, Calibration, ConfidenceInterval, Estimate, TraceResult
from vgtjax.parameters import Bounds
from vgtjax.plants import on_given_knots

from ..output.files import finite, read_json
from .models import values_of
from .tables import Study


@dataclasses.dataclass(frozen=True)
class Entry:
    """One number of a calibrated model, in the unit of the parameter table."""

    name: str
    symbol: str
    unit: str
    value: float
    initial: float
    std_error: float | None
    free: bool
    lower: float | None
    upper: float | None
    at_bound: bool
    identifiable: bool
    interval: ConfidenceInterval | None
    assumed: bool
    source: str


def tabulate(
    start: eqx.Module,
    model: eqx.Module,
    estimates: Mapping[str, Estimate],
    bounds: Bounds,
    names: Sequence[str] = ("*",),
) -> list[Entry]:
    """Every entry of a model or a controller beside its start, the estimated ones and the others, or of `names`.

    A table that was moved to other knots starts from its old force at the new ones.
    """
    table = vgtjax.parameter_table(model)
    everything = vgtjax.select(model, free=names)
    values = everything.values(model).tolist()
    initials = everything.values(on_given_knots(start, values_of(model))).tolist()
    found = []
    for name, value, initial in zip(everything.entries, values, initials, strict=True):
        row = vgtjax.parameters.table_row(table, name)
        known = estimates.get(name, Estimate(value, str(row.unit)))
        error, ends = finite(known.std_error), bounds.get(name, (None, None))
        numbers = (value, initial, error, name in estimates, *ends, known.at_bound, known.determined)
        found.append(Entry(name, row.symbol, str(row.unit), *numbers, _ends(known), row.assumed, row.source))
    return found


def _ends(known: Estimate) -> ConfidenceInterval | None:
    """As JSON has an interval: an open end is `None`, and so is the whole that has none."""
    low, high = finite(known.interval)
    return None if low is None and high is None else (low, high)


def calibrated(calibration: Calibration, around: Around | None = None, *, usable: bool = True) -> list[Entry]:
    """Every entry of the fitted model, free and held.

    **Arguments:** `around`: the misfit around the end, whose intervals take the place of the linear ones;
    `usable`: whether the fit stands behind its values at all.
    """
    found = calibration.estimates if around is None else around.estimates(calibration)
    if not usable:
        found = {entry: dataclasses.replace(each, determined=False) for entry, each in found.items()}
    return tabulate(calibration.task.plant, calibration.model, found, calibration.task.bounds)


def by_entry(values: Mapping[str, Any]) -> dict[str, Any]:
    """What is given by parameter, a list for a vector, by entry."""
    scalars = {name: value for name, value in values.items() if np.ndim(value) == 0}
    vectors = {name: value for name, value in values.items() if np.ndim(value) == 1}
    return scalars | {f"{name}[{i}]": value for name, vector in vectors.items() for i, value in enumerate(vector)}


def start_as_study(calibration: Calibration) -> str:
    """The start values of a fit, exact to the last digit, as the `[parameters]` table of a study."""
    lines = [f'"{name}" = {{value = {value!r}}}' for name, value in values_of(calibration.task.plant).items()]
    return "\n".join(["[parameters]", *lines])


SCHEMA = 2
"""Version of `parameters.json`; the first had neither intervals nor nuisance, and is read as well."""
_FIELDS = ("value", "unit", "free", "std_error", "interval", "initial", "lower", "upper", "at_bound", "identifiable")


def nuisance(calibration: Calibration) -> dict[str, Any]:
    """What a fit found out of each trace besides the parameters, in SI units."""
    late = {} if calibration.duty_delay_error is None else {"duty_delay": calibration.duty_delay}
    of_sensors: dict[str, dict[str, float]] = {"gain": {}, "offset": {}, "initial": {}}
    for entry, (value, _) in calibration.instruments.items():
        kind, _, channel = entry.partition(".")
        of_sensors[kind][channel] = value
    of_starts = of_sensors["initial"]
    gain = {"gain": of_sensors["gain"]} if of_sensors["gain"] else {}

    def found(result: TraceResult) -> dict[str, Any]:
        duty = calibration.found_duty(result.trace)
        driving = calibration.input_sensor(result.trace)
        rest = {"p_act": driving.offset} if driving is not None and driving.offset_error else {}
        offset = {**finite(result.offset), **rest, **of_sensors["offset"]}
        place = f"[{result.trace.start_number - 1}]"
        start = {name.removesuffix(place): value for name, value in of_starts.items() if name.endswith(place)}
        return {
            **late,
            **({"duty_hold": "linear"} if duty.linear else {}),
            **({"duty_edges": list(duty.edges)} if duty.edges else {}),
            **gain,
            **({"start_state": start} if start else {}),
            "offset": offset,
        }

    return {result.trace.name: found(result) for result in calibration.traces}


def covariance(calibration: Calibration) -> dict[str, Any]:
    """Covariance of a fit's errors in the units of the table; `None` for what has none."""
    return {"entries": list(calibration), "matrix": finite(calibration.error_covariance)}


def to_json(study: Study, found: list[Entry], **more: dict[str, Any]) -> dict[str, Any]:
    """The content of `parameters.json`; vector-valued parameters have lists in every field.

    **Arguments:** `more`: other tables of the file, by name.
    """
    parameters: dict[str, Any] = {}
    for entry in found:
        # JSON has no infinity: a `diaphragm.travel` without end is null.
        fields = {field: None if (given := getattr(entry, field)) == math.inf else given for field in _FIELDS}
        name, bracket, _ = entry.name.partition("[")
        if bracket:
            vector = parameters.setdefault(name, {field: [] for field in _FIELDS})
            for field in _FIELDS:
                vector[field].append(fields[field])
        else:
            parameters[name] = fields
    names = {"model": study.model, "components": study.components.names()}
    return {"schema": SCHEMA, **names, "parameters": parameters, **more}


def fit_covariance(path: pathlib.Path, entries: Sequence[str]) -> Float[np.ndarray, "entries entries"] | None:
    """Covariance of the errors of some entries of a `parameters.json`; `None` for a file that does not say it.

    NaN for what the traces did not determine.
    """
    table = read_json(path).get("covariance")
    if table is None:
        return None
    at = [table["entries"].index(entry) for entry in entries]
    return np.array(table["matrix"], dtype=float)[np.ix_(at, at)]


def fitted_entries(path: pathlib.Path) -> list[str]:
    """The entries that a fit moved, in the order of its `parameters.json`."""
    parameters = read_json(path)["parameters"]
    moved = [by_entry({name: fields.get("free", True)}) for name, fields in parameters.items()]
    return [entry for free in moved for entry, is_free in free.items() if is_free]
