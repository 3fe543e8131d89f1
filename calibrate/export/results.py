"""What is exported: the parameters of one actuator with their uncertainty, and the traces that they come from."""

import dataclasses
import math
import pathlib
from collections.abc import Callable
from typing import Any

import vgtjax
from vgtjax import InputError

from ..output.console import console
from ..output.files import SUMMARY, read_json
from ..study.characteristics import READERS
from ..study.start_file import load_model, read_parameters, unit_files
from ..study.tables import Study


def _is_number(given: Any) -> bool:
    return given is None or (isinstance(given, int | float) and not isinstance(given, bool))


def _is_interval(given: Any) -> bool:
    return given is None or (isinstance(given, list) and len(given) == 2 and all(map(_is_number, given)))


FIELDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "unit": (lambda given: isinstance(given, str), "a text"),
    "std_error": (_is_number, "a number or null"),
    "interval": (_is_interval, "two numbers, or null"),
}
"""What stands beside the value of a parameter, and what it must be."""


@dataclasses.dataclass(frozen=True)
class ExportedEntry:
    """One number of a calibrated model; what is not known is `None`."""

    name: str
    value: float
    unit: str
    std_error: float | None
    low: float | None
    high: float | None
    free: bool
    identifiable: bool


@dataclasses.dataclass(frozen=True, eq=False)
class Results:
    """A fit of one actuator: its study's model, the model with its values, and what its files say.

    `hashes` are the SHA-256 of its traces, by their names.
    """

    study: Study
    model: vgtjax.AbstractModel
    parameters: dict[str, dict[str, Any]]
    hashes: dict[str, str]

    @property
    def rows(self) -> list[ExportedEntry]:
        """Every entry, in the order of the parameter table."""
        return [row for name in vgtjax.parameter_table(self.model) for row in self.rows_of(name)]

    def rows_of(self, name: str) -> list[ExportedEntry]:
        """The entries of one parameter."""
        fields = self.parameters[name]
        if not isinstance(fields["value"], list):
            return [_row(name, fields)]
        apart = [
            {key: field[i] if isinstance(field, list) else field for key, field in fields.items()}
            for i in range(len(fields["value"]))
        ]
        return [_row(f"{name}[{index}]", each) for index, each in enumerate(apart)]


def _row(name: str, fields: dict[str, Any]) -> ExportedEntry:
    low, high = fields.get("interval") or (None, None)
    value = math.inf if fields["value"] is None else float(fields["value"])
    free, known = bool(fields.get("free")), bool(fields.get("identifiable"))
    return ExportedEntry(name, value, fields["unit"], fields.get("std_error"), low, high, free, known)


def read_results(place: pathlib.Path) -> Results:
    """The results of a fit.

    **Arguments:** `place`: a `parameters.json`, or the folder of one actuator's fit.

    **Raises:** `InputError` for a folder with several units, or a file that no fit wrote.
    """
    units = list(unit_files(place)) if place.is_dir() and not (place / "parameters.json").exists() else []
    if units:
        raise InputError(
            f"one actuator is exported at a time, but {place} holds {len(units)}: {', '.join(units)}; give one of "
            f"them, e.g. {place / units[0]}"
        )
    if place.suffix.lower() in READERS:
        raise InputError(
            f"{place.name}: what is exported is a parameters.json or the folder of a fit; give one of them"
        )
    path, content = read_parameters(place)
    study, model = load_model(path, content)
    lacking = [name for name in vgtjax.parameter_table(model) if "unit" not in content["parameters"].get(name, {})]
    if lacking:
        raise InputError(f"{path.name}: it does not state '{lacking[0]}' with its unit; give one that 'fit' wrote")
    for name in vgtjax.parameter_table(model):
        _require_fields(path, name, content["parameters"][name])
    return Results(study, model, content["parameters"], _hashes(path.with_name(SUMMARY)))


def _require_fields(path: pathlib.Path, name: str, fields: dict[str, Any]) -> None:
    """Refuses what no fit writes beside a value; one that has no list counts for all entries of a vector."""
    value = fields["value"]
    for key, (is_right, wanted) in FIELDS.items():
        given = fields.get(key)
        each = given if isinstance(value, list) and isinstance(given, list) else None
        if each is not None and len(each) != len(value):
            raise InputError(
                f"{path.name}: '{name}' has {len(value)} values, but {len(each)} under {key}; give one for each"
            )
        if not all(map(is_right, [given] if each is None else each)):
            raise InputError(
                f"{path.name}: {key} of '{name}' must be {wanted}, but it is {given!r}; give a file that 'fit' wrote"
            )


def _hashes(summary: pathlib.Path) -> dict[str, str]:
    if not summary.exists():
        console.print(f"note: there is no {SUMMARY} beside the parameters, so the export names no traces")
        return {}
    content = read_json(summary)
    traces = content.get("traces", {}) if isinstance(content, dict) else None
    if not isinstance(traces, dict) or not all(isinstance(fields, dict) for fields in traces.values()):
        raise InputError(
            f"{summary.name}: beside parameters only the summary of their fit may stand, but this is none; remove it"
        )
    return {name: str(fields["sha256"]) for name, fields in traces.items() if "sha256" in fields}
