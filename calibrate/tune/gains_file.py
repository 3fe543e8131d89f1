"""`gains.json`: gains, tuned or written by hand, and the actuator that their controller believes in."""

import dataclasses
import math
import pathlib
from collections.abc import Sequence
from typing import Any

import vgtjax
from vgtjax import InputError
from vgtjax.control import AbstractController, check
from vgtjax.parameters import entry_names, unknown_name

from ..output.files import finite, read_json
from ..study.models import check_length
from ..study.parameter_file import Entry, tabulate, to_json
from ..study.start_file import NAMED, load_model, require_components
from ..study.tables import FullStudy, Study
from .designs import DESIGNS, design_for
from .fallback import FALLBACK, fallback_of, with_fallback

NAME = "gains.json"


@dataclasses.dataclass(frozen=True, eq=False)
class TunedController:
    """A controller with its gains and its fallback, by the name of its design; `period` in s is its sampling time."""

    design: str
    controller: AbstractController
    period: float


def gains_json(study: Study, entries: Sequence[Entry], believed: vgtjax.AbstractModel) -> dict[str, Any]:
    """The content of the file; a gain that was chosen has no standard error."""
    control, known = study.control, _known(study, believed)
    head = {"design": control.design, "period": control.period, "fallback": fallback_of(study)}
    of_plant = FullStudy() if control.belief == "printed" else study  # whose components the believed actuator has
    return {**head, **to_json(of_plant, list(entries), plant=known)}


def _known(study: Study, believed: vgtjax.AbstractModel) -> dict[str, dict[str, Any]]:
    """The parameters of a plant by name, each with its value and unit."""
    plant = to_json(study, tabulate(believed, believed, {}, {}))["parameters"]
    return {name: {key: fields[key] for key in ("value", "unit")} for name, fields in plant.items()}


def note_on_plant(path: pathlib.Path, study: Study, believed: vgtjax.AbstractModel) -> str | None:
    """A sentence where gains were tuned for another actuator than the one that their controller is told of here."""
    path = path / NAME if path.is_dir() else path
    plant, known = read_json(path).get("plant"), finite(_known(study, believed))  # JSON has no infinity
    if not isinstance(plant, dict):  # written by hand
        return None
    other = [name for name, fields in plant.items() if fields != known.get(name)]
    if not other:
        return None
    return (
        f"{path.name} was tuned for another actuator than the one that its controller believes in here: they differ in "
        f"{', '.join(other[:NAMED])}{'' if len(other) <= NAMED else f' and {len(other) - NAMED} more'}; give the same "
        "--parameters and [parameters] as to tune"
    )


def note_on_period(path: pathlib.Path, study: Study) -> str | None:
    """A sentence where gains were tuned for samples of another period than the study's."""
    path = path / NAME if path.is_dir() else path
    period = read_json(path).get("period")
    if not isinstance(period, float) or math.isclose(period, study.control.period):
        return None
    return (
        f"{path.name} was tuned for samples every {1e3 * period:g} ms, but the study's are "
        f"{1e3 * study.control.period:g} ms apart; tune again, or state that period under [control]"
    )


def find_gains(place: pathlib.Path) -> pathlib.Path | None:
    """The file of gains that this is, or that lies in this folder of `tune`; `None` for results of another kind."""
    path = place / NAME if place.is_dir() else place
    if path.suffix != ".json" or not path.exists():
        return None
    content = read_json(path)
    return path if isinstance(content, dict) and "design" in content else None


def load_controller(path: pathlib.Path) -> TunedController:
    """The controller of a file of gains.

    **Raises:** `InputError` for a file that `tune` did not write as it does today.
    """
    content = _read(path)
    design, plant, period = (content.get(key) for key in ("design", "plant", "period"))
    if not isinstance(design, str) or design not in DESIGNS:
        raise InputError(
            f"{path.name}: its design must be one of {', '.join(DESIGNS)}, but it is {design!r}; tune again"
        )
    if not isinstance(plant, dict) or not isinstance(period, float) or not period > 0:
        raise InputError(
            f"{path.name}: it does not state the plant that its controller believes in and its period; tune again"
        )
    if content.get("model") != "full":
        raise InputError(
            f"{path.name}: its plant must be of model = 'full', but it is {content.get('model')!r}; tune again"
        )
    require_components(path, content)
    believed: Any = load_model(path, {**content, "parameters": plant})[1]
    try:
        controller = design_for(design, believed, period)
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from error
    controller = vgtjax.replace_parameters(controller, _gains_in(path, content, controller))
    return TunedController(design, with_fallback(_fallback(path, content), believed, controller), period)


def _fallback(path: pathlib.Path, content: dict[str, Any]) -> dict[str, Any] | None:
    """What the file says of it; nothing in files of before there was one."""
    said = content.get("fallback")
    if said is None:
        return None
    patience = said.get("patience", math.nan) if isinstance(said, dict) and said.get("kind") == FALLBACK else math.nan
    if patience is not None and not (isinstance(patience, int | float) and patience > 0):
        raise InputError(
            f"{path.name}: its fallback must be of kind '{FALLBACK}' with a patience in s, or null for ever, but it is "
            f"{said!r}; tune again"
        )
    return said


def read_gains(path: pathlib.Path, design: str, controller: AbstractController) -> dict[str, Any]:
    """Gains by name from a file, or from the folder that `tune` wrote it to.

    **Raises:** `InputError` for a file of another design, a name that the controller has not, or a value that
    is none or that the design does not allow.
    """
    path = path / NAME if path.is_dir() else path
    content = _read(path)
    if content.get("design") != design:
        raise InputError(
            f"{path.name}: these are gains of the design '{content.get('design')}', but the study's is '{design}'; "
            "give gains of the same design"
        )
    return _gains_in(path, content, controller)


def _read(path: pathlib.Path) -> dict[str, Any]:
    """The content of a file that has a table of gains."""
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("parameters"), dict):
        raise InputError(f"{path.name}: these are no gains of a controller; give a gains.json that 'tune' wrote")
    return content


def _gains_in(path: pathlib.Path, content: dict[str, Any], controller: AbstractController) -> dict[str, Any]:
    """Gains by name that the content of a file states, with which the controller keeps its rules."""
    table = vgtjax.parameter_table(controller)
    values: dict[str, Any] = {}
    for name, fields in content["parameters"].items():
        if name not in table:
            raise unknown_name(f"{path.name}: gain", name, list(table))
        if isinstance(fields, dict) and "value" not in fields:
            raise InputError(f"{path.name}: the gain '{name}' has no value; add it")
        given: Any = fields["value"] if isinstance(fields, dict) else fields
        values[name] = math.inf if given is None else given  # JSON has no infinity
        for each in values[name] if isinstance(values[name], list) else [values[name]]:
            if isinstance(each, bool) or not isinstance(each, int | float):
                raise InputError(f"{path.name}: the gain '{name}' must be a number, but it is {each!r}; correct it")
    try:
        for name, value in values.items():
            check_length(name, "value", value, entry_names({name: table[name]}))
        check(vgtjax.replace_parameters(controller, values))
    except InputError as error:  # the file is at fault, not what the study states
        raise InputError(f"{path.name}: {error}") from error
    return values
