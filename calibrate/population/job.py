"""From a study to a population, the experiments that it goes through, and what the bench measured of its units."""

import dataclasses
import pathlib
from typing import Any

import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.errors import InputError
from vgtjax.experiments import AbstractExperiment, MeasuredLoops, SlowLoop, StepResponse, measure_loops, nominal_target
from vgtjax.population import Population, fitted_levels, fitted_population

from ..files import read_json
from ..job import load_source
from ..models import build_model, check_bounds, on_given_knots, start_values
from ..parameter_file import fitted_entries, load_values, unit_files
from ..study import TraceSource, expand_traces, fingerprint, load_study
from ..study_tables import Study
from .spreads import stated_population

FLEET = pathlib.Path(__file__).parents[1] / "example" / "fleet" / "study.toml"
"""The study that runs when none is named."""
POINTS = (0.0, 1.5e5, 3.0e5)
"""Pa gauge; the thesis's turbine pressures (section 4.2)."""


@dataclasses.dataclass(frozen=True, eq=False)
class PopulationJob:
    """Everything that a population study needs; nothing has been written yet."""

    study: Study
    text: str
    fingerprint: str
    population: Population
    fitted: dict[str, vgtjax.AbstractModel]
    """Fitted units, if the population comes from such."""
    experiments: tuple[AbstractExperiment, ...]
    measured: dict[str, MeasuredLoops]
    notes: tuple[str, ...]


def prepare_population(path: pathlib.Path | None, parameters: pathlib.Path | None, *, levels: bool) -> PopulationJob:
    """Reads and checks a study of a population.

    **Arguments:** `path`: the study, or `None` for the example that ships; `parameters`: of the nominal actuator, or a
    folder with several fitted units; `levels`: whether quantities must be independent, one a curve.

    **Raises:** `InputError` for the first thing that is wrong.
    """
    path = FLEET if path is None else path
    study = load_study(path)
    if study.model != "full":
        raise InputError(f"a population study needs model = 'full', but it is '{study.model}'; change it")
    if parameters is None and study.population.units is not None:
        parameters = path.parent / study.population.units
    model = on_given_knots(build_model(study), {name: given.value for name, given in study.parameters.items()})
    values = _given_values(parameters, study, model)
    models = _models(model, study, values)
    sources = expand_traces(study, path.parent)
    measured = _measured(study, sources, models[0])
    population, notes = _population(study, dict(zip(values, models, strict=True)), parameters, levels)
    notes += _more_notes(population.model, sources, measured)
    return PopulationJob(
        study,
        path.read_text(encoding="utf-8-sig"),
        fingerprint(study, sources, values),
        population,
        {} if None in values else dict(zip(map(str, values), models, strict=True)),
        _experiments(study, population.model, measured),
        measured,
        notes,
    )


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
    """A model for every unit, all on the knots of the first; what the study states goes before a nominal actuator."""
    models: list[vgtjax.AbstractModel] = []
    knots: dict[str, Any] = {}
    for given in values.values():
        start = vgtjax.replace_parameters(on_given_knots(model, given), given)
        stated, bounds = start_values(start, study)
        start = vgtjax.replace_parameters(start, stated)
        check_bounds(start, bounds)
        knots = knots or {
            name: np.asarray(vgtjax.get_parameter(start, name)).tolist() for name in vgtjax.parameter_table(start)
        }
        models.append(on_given_knots(start, knots))
    return models


def _population(
    study: Study,
    models: dict[str | None, vgtjax.AbstractModel],
    parameters: pathlib.Path | None,
    levels: bool,
) -> tuple[Population, tuple[str, ...]]:
    table = study.population
    if None in models:
        population = stated_population(models[None], table)
        notes = []
        if not table.parameters and "relative" not in table.model_fields_set:
            notes.append(
                "the study states no tolerances, so every quantity has a standard deviation of "
                f"{table.relative:.0%} of its value; state them under [population]"
            )
        if levels and population.correlation is not None:
            notes.append("sensitivity indices need independent quantities, so the stated correlations are left out")
        return (population.independent() if levels else population), tuple(notes)
    assert parameters is not None
    stated = table.model_fields_set - {"units"}
    if stated:
        raise InputError(
            f"a population of fitted units has their spread, but [population] states {', '.join(sorted(stated))} too; "
            "drop that, or give the parameters of one actuator"
        )
    entries = [fitted_entries(file) for file in unit_files(parameters).values()]
    common = [entry for entry in entries[0] if all(entry in other for other in entries)]
    population = fitted_population(list(models.values()), common)
    doubts = _unconverged(parameters)
    if not levels:
        return population, doubts
    note = (
        "sensitivity indices need independent quantities, so the correlation of the fitted units is left out, and each "
        "curve varies by a common factor; errors of the fits no longer cancel then, so outputs spread more "
        "than the units do"
    )
    return fitted_levels(population, list(models.values())), (note, *doubts)


def _unconverged(folder: pathlib.Path) -> tuple[str, ...]:
    """A note on fitted units whose fit did not converge, where the fit's summaries are still beside them."""
    summaries = {unit: file.with_name("summary.json") for unit, file in unit_files(folder).items()}
    bad = [unit for unit, file in summaries.items() if file.exists() and not read_json(file).get("converged", True)]
    return (f"the fits of {', '.join(bad)} have not converged, but count like the others",) if bad else ()


def _more_notes(
    model: vgtjax.AbstractModel, sources: list[TraceSource], measured: dict[str, MeasuredLoops]
) -> tuple[str, ...]:
    notes = []
    vanes = getattr(model, "vane_force", None)
    if isinstance(vanes, vgtjax.HysteresisMap) and not np.any(vanes.closing) and not np.any(vanes.opening):
        notes.append(
            "the tables of vane_force = 'map' are all zero, so gas acts on nothing; give --parameters of a fit"
        )
    if sources and not measured:
        notes.append("no trace of the study is a slow loop with position and pressure, so nothing measured is shown")
    return tuple(notes)


def _measured(study: Study, sources: list[TraceSource], model: vgtjax.AbstractModel) -> dict[str, MeasuredLoops]:
    """Loops by unit of all traces that are such."""
    bounds = start_values(model, study)[1]
    points = POINTS if study.experiments.turbine_pressure is None else study.experiments.turbine_pressure
    found = {}
    for unit in sorted({source.unit for source in sources}, key=str):
        traces = [load_source(source, model, bounds, ()) for source in sources if source.unit == unit]
        loops = measure_loops(traces, points)
        if loops is not None:
            found[study.name if unit is None else unit] = loops
    return found


def _experiments(
    study: Study, model: vgtjax.AbstractModel, measured: dict[str, MeasuredLoops]
) -> tuple[AbstractExperiment, ...]:
    table = study.experiments
    pressures = table.turbine_pressure
    if pressures is None:
        seen = {at for loops in measured.values() for at in loops.turbine_pressures}
        # Gas that acts on nothing gives the same loop at every pressure.
        pressures = sorted(seen or set(POINTS)) if _feels_gas(model) else [0.0]
    loop = SlowLoop(tuple(pressures), table.loop_seconds, table.loop_duty)
    if not table.steps:
        return (loop,)
    steps = StepResponse(tuple(table.steps), table.step_seconds, target=jnp.zeros(len(table.steps)))
    return loop, nominal_target(model, steps)


def _feels_gas(model: vgtjax.AbstractModel) -> bool:
    """Whether turbine pressure acts on a model at all."""
    return not isinstance(getattr(model, "vane_force", None), vgtjax.NoVaneForce) or isinstance(
        getattr(model, "friction", None), vgtjax.AdaptiveLuGre
    )
