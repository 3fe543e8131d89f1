"""The structures that a study may have instead of its own, and the fit of each."""

import threading
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

import vgtjax
from vgtjax import InputError, PassivityWarning
from vgtjax.estimation import Task
from vgtjax.identification import has_gas, plan_fit
from vgtjax.parameters import entry_names, match_entries, parameter_table, select
from vgtjax.plants import on_given_knots

from ..study.components import FullComponents
from ..study.models import build_model, known_beforehand, scales_of, start_model, values_of
from ..study.tables import Study
from ..study.units import Job, Unit

FRICTION = ("lugre", "lugre-squared", "dahl", "karnopp", "coulomb")
"""Not the adaptive one, which is a controller's, nor the passive one, which is LuGre's law in other parameters."""
EXPONENTS = {"lugre": 1, "lugre-passive": 1, "lugre-squared": 2}
"""Of the Stribeck curve, by the friction that has one."""
VANE_FORCE = ("none", "map", "speed-map")
"""Not the polynomial, which is the same in both directions, as no trace shows it."""
LINE = ("none", "delay")
"""Not the wave equation, which takes many small steps for the same delay and loss."""
CHAMBER = ("adiabatic", "wall", "isothermal")
WIDER = {
    "map": ("none",),
    "speed-map": ("none",),
    "delay": ("none",),
    "wall": ("adiabatic", "isothermal"),
    "lugre": ("dahl",),
    "lugre-passive": ("dahl",),
    "lugre-squared": ("dahl",),
    "karnopp": ("coulomb",),
}
"""Which variants contain which others as a limit."""
ALIKE = {
    name: tuple(other for other, power in EXPONENTS.items() if power != exponent)
    for name, exponent in EXPONENTS.items()
}
"""Which variants have parameters that make up for what tells them from which others: those of another exponent."""
STILL = "the turbine pressure is zero in all traces"
_FILTERING = threading.Lock()
"""Filters of warnings belong to the process, and the fits of structures to several threads."""


def own_structure(study: Study) -> dict[str, str]:
    """The components of a study that may be others, in the order in which they are compared."""
    parts = study.components
    found = {"vane_force": parts.vane_force, "friction": parts.friction}
    return found | ({"line": parts.line, "chamber": parts.chamber} if isinstance(parts, FullComponents) else {})


def options(study: Study, unit: Unit) -> dict[str, list[str]]:
    """The variants of every component that the traces of a unit may tell apart, its own among them."""
    own = own_structure(study)
    every = {"vane_force": VANE_FORCE, "friction": FRICTION, "line": LINE, "chamber": CHAMBER}
    if not any(map(has_gas, unit.used("fit"))):
        del every["vane_force"]
    if own["friction"] == "lugre-passive":
        every["friction"] = FRICTION[1:]
    return {name: list(dict.fromkeys((own[name], *every[name]))) for name in every if name in own}


def plan(job: Job, unit: Unit, structure: Mapping[str, str], values: Mapping[str, Any]) -> Task:
    """The task of fitting a structure to the traces of a unit.

    **Arguments:** `values` of a model with another structure; those that both have are where it starts.
    """
    study = job.study
    changed = [name for name, variant in structure.items() if variant != own_structure(study)[name]]
    model, bounds, known, scales = unit.model, unit.bounds, unit.known, unit.scales
    with _FILTERING, warnings.catch_warnings():
        warnings.simplefilter("ignore", PassivityWarning)  # on the way from one structure to another
        if changed:
            study = study.model_copy(update={"components": study.components.model_copy(update=dict(structure))})
            study = _that_fits(study, build_model(study))
            # What an earlier fit is started from holds for what both models have.
            given = values_of(unit.model)
            bare = build_model(study)
            model, bounds = start_model(bare, study, _shared(bare, given))
            known, scales = known_beforehand(model, study.parameters), scales_of(model, study.parameters)
        if values:
            model = on_given_knots(model, dict(values))
            model = vgtjax.replace_parameters(model, _shared(model, values))
        choices = {"free": _free(unit, study, model), "fixed": study.fit.fixed, "unknown": unit.unknown(study)}
        stated = {
            **known._asdict(),
            "scales": scales,
            "gains": study.report.gains,
            "offsets": study.report.offsets,
        }
        return plan_fit(model, unit.used("fit"), unit.used("validate"), **choices, **stated, bounds=bounds)


def _free(unit: Unit, study: Study, model: vgtjax.AbstractModel) -> list[str] | None:
    """What the study frees: it names parameters of its own structure, so what another has besides is free as well."""
    if study.fit.free is None:
        return None
    known = parameter_table(unit.model)
    return [*study.fit.free, *(entry for entry in select(model).entries if entry.partition("[")[0] not in known)]


def _shared(model: vgtjax.AbstractModel, values: Mapping[str, Any]) -> dict[str, Any]:
    """Those values that a model has a place for."""
    model = on_given_knots(model, dict(values))
    sizes = {name: row.size for name, row in parameter_table(model).items()}
    return {
        name: value
        for name, value in values.items()
        if name in sizes and (np.ndim(value) == 0 if sizes[name] is None else np.shape(value) == (sizes[name],))
    }


def _that_fits(study: Study, model: vgtjax.AbstractModel) -> Study:
    """`study` without what it says of parameters that only its own structure has."""
    stated = {name: given for name, given in study.parameters.items() if _known(model, name)}
    names = {key: _patterns(model, getattr(study.fit, key)) for key in ("free", "fixed")}
    return study.model_copy(update={"parameters": stated, "fit": study.fit.model_copy(update=names)})


def _patterns(model: vgtjax.AbstractModel, patterns: list[str] | None) -> list[str] | None:
    return None if patterns is None else [pattern for pattern in patterns if _known(model, pattern)]


def _known(model: vgtjax.AbstractModel, pattern: str) -> bool:
    if pattern in entry_names(parameter_table(model)):
        return True
    try:
        return bool(match_entries(parameter_table(model), [pattern]))
    except InputError:
        return False
