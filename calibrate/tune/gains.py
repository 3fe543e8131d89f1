"""`gains.json`, read again: gains that were tuned or written by hand, for another run."""

import math
import pathlib
from typing import Any

import vgtjax
from vgtjax import InputError
from vgtjax.control import AbstractController, check
from vgtjax.parameters import entry_names, unknown_name

from ..output.files import read_json
from ..study.models import check_length

FILE = "gains.json"


def read_gains(path: pathlib.Path, design: str, controller: AbstractController) -> dict[str, Any]:
    """Gains by name from a file, or from the folder that `tune` wrote it to.

    **Raises:** `InputError` for a file of another design, a name that the controller has not, or a value that
    is none or that the design does not allow.
    """
    path = path / FILE if path.is_dir() else path
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("parameters"), dict):
        raise InputError(f"{path.name}: these are no gains of a controller; give a gains.json that 'tune' wrote")
    if content.get("design") != design:
        raise InputError(
            f"{path.name}: these are gains of the design '{content.get('design')}', but the study's is '{design}'; "
            "give gains of the same design"
        )
    table = vgtjax.parameter_table(controller)
    values: dict[str, Any] = {}
    for name, fields in content["parameters"].items():
        if name not in table:
            raise unknown_name(f"{path.name}: gain", name, list(table))
        given: Any = fields.get("value") if isinstance(fields, dict) else fields
        values[name] = math.inf if given is None else given  # JSON has no infinity
        for each in values[name] if isinstance(values[name], list) else [values[name]]:
            if isinstance(each, bool) or not isinstance(each, int | float):
                raise InputError(f"{path.name}: the gain '{name}' must be a number, but it is {each!r}; correct it")
        check_length(name, "value", values[name], entry_names({name: table[name]}))
    try:
        check(vgtjax.replace_parameters(controller, values))
    except InputError as error:  # the file is at fault, not what the study states
        raise InputError(f"{path.name}: {error}") from error
    return values
