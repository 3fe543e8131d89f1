"""The actuators that a study is about: one nominal actuator with tolerances, or fitted units."""

import dataclasses
import pathlib
from collections.abc import Collection
from typing import Any

import vgtjax
from vgtjax.plants import on_given_knots
from vgtjax.population import FittedUnit, Population, Spread, fitted_levels, population_of_units, spread_population

from ..output.files import read_json
from ..study.models import build_model, say_not_as_stated, start_model, values_of
from ..study.parameter_file import fit_covariance, fitted_entries
from ..study.places import OF_A_POPULATION, StudyError, of_study, stated
from ..study.read import hash_file
from ..study.start_file import load_values, unit_files
from ..study.tables import Study


@dataclasses.dataclass(frozen=True, eq=False)
class Actuators:
    """A population, and the units that it comes from if it was fitted.

    `values` are what `parameters.json` gave, by unit, those of a nominal actuator under `None`; `first` is the first
    unit's model, or the nominal actuator's; `digests` tell the files of parameters from others.
    """

    values: dict[str | None, dict[str, Any]]
    first: vgtjax.AbstractModel
    population: Population
    fitted: dict[str, vgtjax.AbstractModel]
    notes: tuple[str, ...]
    digests: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def hashed(self) -> dict[str | None, Any]:
        """What the fingerprint of a run depends on."""
        return {**self.values, "files": self.digests}


def read_actuators(
    path: pathlib.Path, study: Study, parameters: pathlib.Path | None, *, levels: bool = False
) -> Actuators:
    """The actuators of a study.

    **Arguments:** `path`: of the study; `parameters`: of the nominal actuator, or a folder with several fitted units,
    by default what the study names; `levels`: whether quantities must be independent, one a curve.
    """
    if parameters is None and study.population.units is not None:
        parameters = path.parent / study.population.units
    model = build_model(study)
    values = _given_values(parameters, study, model)
    models = _models(model, study, values)
    moved = [on_given_knots(each, values_of(models[0])) for each in models]
    population, notes = _population(study, values, models, parameters, levels)
    fitted = {} if None in values else dict(zip(map(str, values), moved, strict=True))
    return Actuators(values, models[0], population, fitted, notes, _digests(parameters))


def _digests(parameters: pathlib.Path | None) -> dict[str, str]:
    """SHA-256 of every file of parameters: a population depends on their covariances as well."""
    if parameters is None:
        return {}
    files = sorted(parameters.rglob("parameters.json")) if parameters.is_dir() else [parameters]
    return {str(place): hash_file(file) for place, file in enumerate(files)}


def _given_values(
    parameters: pathlib.Path | None, study: Study, model: vgtjax.AbstractModel
) -> dict[str | None, dict[str, Any]]:
    """Values by unit; those of the nominal actuator under `None`."""
    if parameters is None:
        return {None: {}}
    files = unit_files(parameters) if parameters.is_dir() and not (parameters / "parameters.json").exists() else {}
    if not files:
        return {None: load_values(parameters, None, study, model)}
    return {unit: load_values(file, None, study, model) for unit, file in files.items()}


def _models(
    model: vgtjax.AbstractModel, study: Study, values: dict[str | None, dict[str, Any]]
) -> list[vgtjax.AbstractModel]:
    """A model for every unit, on the knots that the study states, else on those of its own fit."""
    models = [start_model(model, study, given)[0] for given in values.values()]
    say_not_as_stated(models[0], study, {})
    return models


def _population(
    study: Study,
    values: dict[str | None, dict[str, Any]],
    models: list[vgtjax.AbstractModel],
    parameters: pathlib.Path | None,
    levels: bool,
) -> tuple[Population, tuple[str, ...]]:
    if None in values:
        return _of_tolerances(study, models[0], levels)
    assert parameters is not None, "several actuators come from a folder"
    files = unit_files(parameters).values()
    stated = {name.partition("[")[0] for name in study.parameters}
    units = [_as_fitted(*each, stated) for each in zip(models, files, values.values(), strict=True)]
    return _of_units(study, units, models[0], parameters, levels)


def _as_fitted(
    model: vgtjax.AbstractModel, file: pathlib.Path, given: dict[str, Any], stated: Collection[str]
) -> FittedUnit:
    """A unit on the knots of its own fit, though the study may state others, and with the tables of its own."""
    entries = fitted_entries(file)
    own = on_given_knots(model, given)
    tables = {name for name, row in vgtjax.parameter_table(own).items() if row.axes and name not in stated}
    names = tables.union(entry.partition("[")[0] for entry in entries) & given.keys()
    own = vgtjax.replace_parameters(own, {name: given[name] for name in names})
    return FittedUnit(own, entries, fit_covariance(file, entries))


def _of_tolerances(study: Study, model: vgtjax.AbstractModel, levels: bool) -> tuple[Population, tuple[str, ...]]:
    """Actuators around a nominal one, as the study states their spread."""
    table, notes = study.population, []
    spreads = {name: Spread(**spread.model_dump()) for name, spread in table.parameters.items()}
    pairs = [(each.parameters, each.value) for each in table.correlation]
    with of_study(), stated(OF_A_POPULATION):
        population = spread_population(
            model,
            table.relative,
            spreads=spreads,
            vary=table.vary,
            fixed=table.fixed,
            correlations=pairs,
            passive=table.passive,
        )
    if not table.parameters and "relative" not in table.model_fields_set:
        notes.append(
            "the study states no tolerances, so every quantity has a standard deviation of "
            f"{table.relative:.0%} of its value; state them under [population]"
        )
    if levels and population.correlation is not None:
        notes.append("sensitivity indices need independent quantities, so the stated correlations are left out")
    return (population.independent() if levels else population), tuple(notes)


def _of_units(
    study: Study, units: list[FittedUnit], like: vgtjax.AbstractModel, folder: pathlib.Path, levels: bool
) -> tuple[Population, tuple[str, ...]]:
    """The spread of fitted units, freed of the errors of their fits where all state these, on the knots of a model."""
    table = study.population
    named = table.model_fields_set - {"units", "passive"}
    if named:
        raise StudyError(
            f"a population of fitted units has their spread, but [population] states {', '.join(sorted(named))} too; "
            "drop that, or give the parameters of one actuator"
        )
    with stated(OF_A_POPULATION):
        population = population_of_units(units, like)
    population = dataclasses.replace(population, passive=table.passive)
    doubts = _unconverged(folder)
    if any(unit.covariance is None for unit in units):
        doubts = (
            *doubts,
            "the fitted units do not state the covariance of their errors, so errors of the fits count as spread; fit "
            "them again",
        )
    if not levels:
        return population, doubts
    note = (
        "sensitivity indices need independent quantities, so the correlation of the fitted units is left out, and each "
        "curve varies by a common factor: outputs may spread more than the units do, as what goes together no longer "
        "cancels"
    )
    return fitted_levels(population), (note, *doubts)


def _unconverged(folder: pathlib.Path) -> tuple[str, ...]:
    """A note on fitted units whose fit did not converge, where the fit's summaries are still beside them."""
    summaries = {unit: file.with_name("summary.json") for unit, file in unit_files(folder).items()}
    bad = [unit for unit, file in summaries.items() if file.exists() and not read_json(file).get("converged", True)]
    return (f"the fits of {', '.join(bad)} have not converged, but count like the others",) if bad else ()
