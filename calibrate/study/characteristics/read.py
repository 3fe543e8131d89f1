"""From a file of characteristics to what a command starts from."""

import math
import pathlib
from typing import Any

from vgtjax import InputError

from .base import DERIVED, UNENDING, Found, parameter_name
from .cdfx import read_cdfx
from .dcm import read_dcm

READERS = {".cdfx": read_cdfx, ".dcm": read_dcm}
"""By the ending of a file's name."""


def read_data_set(path: pathlib.Path) -> dict[str, Any]:
    """A CDFX or DCM file as the content of a `parameters.json`: values and units by parameter or entry.

    Model and components are there where the file names them.
    """
    try:
        text, everything = READERS[path.suffix.lower()](path)
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror}); check the path") from error
    parameters: dict[str, Any] = {}
    for found in everything:
        name = parameter_name(found.identifier)
        if name.startswith(DERIVED):
            continue
        if name in parameters:
            raise InputError(f"{path.name}: '{found.identifier}' occurs twice; remove one of them")
        parameters[name] = {"value": _value(path, found), "unit": found.unit}
    return {**_model(text), "parameters": parameters}


def _model(text: str) -> dict[str, Any]:
    """`model` and `components` from their line in a file; empty for another text."""
    pairs = dict(word.split("=", 1) for word in text.split() if "=" in word)
    model = pairs.pop("model", None)
    return {} if model is None else {"model": model, "components": pairs}


def _value(path: pathlib.Path, found: Found) -> Any:
    numbers = [_number(path, found, text) for text in found.values]
    if not found.is_number:
        return numbers
    if len(numbers) != 1:
        raise InputError(
            f"{path.name}: '{found.identifier}' must have one value, but it has {len(numbers)}; correct it"
        )
    return numbers[0]


def _number(path: pathlib.Path, found: Found, text: str) -> float | None:
    """A number; `None` for one without end, as in a `parameters.json`."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise InputError(
            f"{path.name}: the value of '{found.identifier}' must be a number, but it is '{text}'; correct it"
        )
    return None if value >= UNENDING else value
