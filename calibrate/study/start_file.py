"""What a command starts from: a `parameters.json` of any version, or a data set of a control unit."""

import dataclasses
import itertools
import math
import pathlib
from typing import Any

import pydantic

import vgtjax
from vgtjax import InputError
from vgtjax.estimation import FoundDuty
from vgtjax.parameters import Parameter, entry_names, table_row, unknown_name
from vgtjax.plants import on_given_knots

from ..output.console import console
from ..output.files import read_json
from .characteristics import READERS, read_data_set
from .components import FullComponents, ReducedComponents
from .models import build_model, check_length, merge
from .parameter_file import SCHEMA
from .tables import AnyStudy, Study

NAMED = 6
"""So many of the parameters that a file leaves out are named."""


def read_parameters(path: pathlib.Path, unit: str | None = None) -> tuple[pathlib.Path, dict[str, Any]]:
    """The file of a unit, given itself or the folder of a fit with several, and its content in today's form."""
    if path.is_dir():
        inner = path / unit / "parameters.json" if unit is not None else path / "parameters.json"
        if not inner.exists():
            raise InputError(f"{path} has no parameters for {unit or 'a study without units'}; fit that unit first")
        path = inner
    if path.suffix.lower() in READERS:
        return path, read_data_set(path)
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("parameters"), dict):
        raise InputError(f"{path.name}: this is no parameters.json of a fit; give one that 'fit' wrote")
    return path, _migrated(path, content)


def require_components(path: pathlib.Path, content: dict[str, Any]) -> None:
    """**Raises:** `InputError` for a file whose components are no table; it may name none."""
    components = content.get("components", {})
    if not isinstance(components, dict):
        raise InputError(
            f"{path.name}: its components must be names by part, but they are {components!r}; correct them"
        )


def _migrated(path: pathlib.Path, content: dict[str, Any]) -> dict[str, Any]:
    """The content of a `parameters.json` as today's version has it; a file of the first names no schema."""
    require_components(path, content)
    schema = content.get("schema", 1)
    if isinstance(schema, bool) or not isinstance(schema, int) or not 1 <= schema <= SCHEMA:
        raise InputError(
            f"{path.name}: its schema must be a number from 1 to {SCHEMA}, but it is {schema!r}; use a newer vgtjax"
        )
    if schema == 1:  # it had neither intervals nor nuisance
        parameters = {name: _with_interval(fields) for name, fields in content["parameters"].items()}
        content = {"nuisance": {}, **content, "parameters": parameters}
    return {**content, "model": content.get("model"), "schema": SCHEMA}


def _with_interval(fields: Any) -> Any:
    if not isinstance(fields, dict):
        return fields
    value = fields.get("value")
    return {"interval": [None] * len(value) if isinstance(value, list) else None, **fields}


def beside(found: FoundDuty, delay: float | None, hold: str | None) -> FoundDuty:
    """What was found of the duty of a trace whose study states its delay or hold, without that: it is applied where the
    trace is read.

    Edges that were found beside another delay are left out.
    """
    edges = () if found.delay else found.edges
    timely = FoundDuty(0.0, found.linear, edges) if delay is not None else found
    return timely if hold is None else dataclasses.replace(timely, linear=False)


def load_duties(path: pathlib.Path, unit: str | None) -> dict[str, FoundDuty]:
    """What a fit has found of the duty of each of its traces."""
    path, content = read_parameters(path, unit)
    traces = content.get("nuisance", {})
    if not isinstance(traces, dict) or not all(isinstance(fields, dict) for fields in traces.values()):
        raise InputError(f"{path.name}: its nuisance must be a table for each trace, but it is not; correct it")
    duties = {}
    for name, fields in traces.items():
        delay, hold = fields.get("duty_delay", 0.0), fields.get("duty_hold", "zero-order")
        if isinstance(delay, bool) or not isinstance(delay, int | float) or not -1 < delay < 1:
            raise InputError(
                f"{path.name}: the duty_delay of '{name}' must be seconds between -1 and 1, but it is {delay!r}; "
                "correct it"
            )
        if hold not in ("zero-order", "linear"):
            raise InputError(
                f"{path.name}: the duty_hold of '{name}' must be 'zero-order' or 'linear', but it is {hold!r}; correct "
                "it"
            )
        edges = fields.get("duty_edges", [])
        if not isinstance(edges, list) or not all(isinstance(each, int | float) and -1 < each < 1 for each in edges):
            raise InputError(
                f"{path.name}: the duty_edges of '{name}' must be a list of seconds between -1 and 1, but they are "
                f"{edges!r}; correct them"
            )
        duties[name] = FoundDuty(float(delay), hold == "linear", tuple(map(float, edges)))
    return duties


def load_values(path: pathlib.Path, unit: str | None, study: Study, model: vgtjax.AbstractModel) -> dict[str, Any]:
    """Values by name from a file that [`read_parameters`][] reads; what it leaves out is said, and stays."""
    return _values(*read_parameters(path, unit), study, model)


def load_beginning(path: pathlib.Path, unit: str | None) -> dict[str, Any]:
    """Where the fit began that a file is of, by name, as far as it says so."""
    _, content = read_parameters(path, unit)
    return {name: fields["initial"] for name, fields in content["parameters"].items() if "initial" in fields}


def _values(path: pathlib.Path, content: dict[str, Any], study: Study, model: vgtjax.AbstractModel) -> dict[str, Any]:
    _require_same_model(path, content, study)
    table = vgtjax.parameter_table(model)
    known, given = [*table, *entry_names(table)], {}
    for name, fields in content["parameters"].items():
        if name not in known:
            raise unknown_name(f"{path.name}: parameter", name, known)
        given[name] = value_in(path, name, fields)
        _require_unit(path, name, fields.get("unit"), table)
    try:
        values = _by_parameter(model, given)
    except InputError as error:  # the file is at fault, not what the study states
        raise InputError(f"{path.name}: {error}") from error
    _say_missing(path, [name for name in table if name not in values])
    return values


def _require_same_model(path: pathlib.Path, content: dict[str, Any], study: Study) -> None:
    """A data set that names no model is taken for the study's; a `parameters.json` names its own."""
    wanted = study.components.names()
    if content.get("model", study.model) != study.model:
        raise InputError(
            f"{path.name}: these are parameters of the model '{content['model']}', but the study's is "
            f"'{study.model}'; give parameters of the same model"
        )
    parts = study.components
    usual = {"flow_map": parts.usual_map} if isinstance(parts, ReducedComponents) else {}  # files may leave it out
    if usual | content.get("components", wanted) != usual | wanted:
        raise InputError(
            f"{path.name}: these are parameters of a model with other components than the study's; give "
            "parameters of the same components"
        )


def value_in(path: pathlib.Path, name: str, fields: Any) -> Any:
    """The value of a parameter or of its entries, as its file states it."""
    if not isinstance(fields, dict) or "value" not in fields:
        raise InputError(f"{path.name}: the parameter '{name}' has no value; add it")
    value = math.inf if fields["value"] is None else fields["value"]
    for each in value if isinstance(value, list) else [value]:
        if isinstance(each, bool) or not isinstance(each, int | float):
            raise InputError(f"{path.name}: the value of '{name}' must be a number, but it is {each!r}; correct it")
    return value


def _require_unit(path: pathlib.Path, name: str, given: Any, table: dict[str, Parameter]) -> None:
    """Refuses another unit than the table's; a file may leave it out."""
    units = given if isinstance(given, list) else [given]
    entries = entry_names({name: table[name]}) if name in table else [name]
    wanted = [str(table_row(table, entry).unit) for entry in entries]
    for unit, right in zip(units, itertools.cycle(wanted), strict=False):  # all entries of a longer table have one unit
        if unit is not None and unit != right:
            raise InputError(
                f"{path.name}: the unit of '{name}' must be '{right}', but it is '{unit}'; convert its value"
            )


def _by_parameter(model: vgtjax.AbstractModel, given: dict[str, Any]) -> dict[str, Any]:
    """Values by parameter, of which some may be given by entry."""
    whole = {name: value for name, value in given.items() if not name.endswith("]")}
    model = on_given_knots(model, whole)
    table = vgtjax.parameter_table(model)
    values = dict(whole)
    for name, value in given.items():
        check_length(name, "value", value, entry_names({name: table[name]}) if name in table else [name])
        if name not in whole:
            values |= merge(model, values, name, value)
    vgtjax.replace_parameters(on_given_knots(model, values), values)
    return values


def _say_missing(path: pathlib.Path, missing: list[str]) -> None:
    if missing:
        more = f" and {len(missing) - NAMED} more" if len(missing) > NAMED else ""
        console.print(f"note: {path.name} says nothing of {', '.join(missing[:NAMED])}{more}: they keep their values")


def load_model(path: pathlib.Path, content: dict[str, Any]) -> tuple[Study, vgtjax.AbstractModel]:
    """The model of a `parameters.json`, and the study of one that states no more than this model.

    **Arguments:** `content`: of `path`, as [`read_parameters`][] has it.
    """
    usual = FullComponents().names()
    chosen = {part: name for part, name in dict(content.get("components", {})).items() if name != usual.get(part)}
    try:
        study = AnyStudy.validate_python({"model": content.get("model"), "components": chosen})
    except pydantic.ValidationError as error:
        raise InputError(f"{path.name}: no study has its model and components; use a newer vgtjax") from error
    model = build_model(study)
    values = _values(path, content, study, model)
    return study, vgtjax.replace_parameters(on_given_knots(model, values), values)


def unit_files(folder: pathlib.Path) -> dict[str, pathlib.Path]:
    """`parameters.json` of every unit below the folder of a fit, by unit."""
    return {path.parent.name: path for path in sorted(folder.glob("*/parameters.json"))}
