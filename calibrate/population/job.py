"""From a study to a population, the experiments that it goes through, and what traces tell of its units."""

import dataclasses
import pathlib

import vgtjax
from vgtjax.experiments import (
    POSITIONS,
    AbstractExperiment,
    MeasuredLoops,
    SlowLoop,
    StepResponse,
    measure_loops,
)
from vgtjax.parts import OPERATING_POINTS, feels_gas
from vgtjax.plants import AbstractRodModel
from vgtjax.population import Population

from ..study.models import start_values
from ..study.places import StudyError, of_study
from ..study.read import TraceSource, expand_traces, fingerprint, load_study
from ..study.tables import Study
from ..study.units import StudyJob, load_source
from .actuators import read_actuators

FLEET = pathlib.Path(__file__).parents[1] / "example" / "fleet" / "study.toml"
"""The study that runs when none is named."""


@dataclasses.dataclass(frozen=True, eq=False)
class PopulationJob(StudyJob):
    """Everything that a population study needs."""

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
    """
    path = FLEET if path is None else path
    study = load_study(path)
    if study.model != "full":
        raise StudyError(f"a population study needs model = 'full', but it is '{study.model}'; change it")
    actuators = read_actuators(path, study, parameters, levels=levels)
    nominal = actuators.population.model
    sources = expand_traces(study, path.parent)
    measured = _measured(study, sources, actuators.first)
    with of_study():
        experiments = _experiments(study, nominal, measured)
    return PopulationJob(
        study,
        path.read_text(encoding="utf-8-sig"),
        fingerprint(study, sources, actuators.hashed),
        actuators.population,
        actuators.fitted,
        experiments,
        measured,
        actuators.notes + _more_notes(study.components.vane_force, nominal, sources, measured),
    )


def _more_notes(
    name: str, model: vgtjax.AbstractModel, sources: list[TraceSource], measured: dict[str, MeasuredLoops]
) -> tuple[str, ...]:
    notes = []
    if isinstance(model, AbstractRodModel) and model.vane_force.feels_gas and not model.vane_force.acts:
        notes.append(
            f"the tables of vane_force = '{name}' are all zero, so gas acts on nothing; give --parameters of a fit"
        )
    if sources and not measured:
        fewest = 2 * (len(POSITIONS) + 1)
        notes.append(
            "no trace of the study is a slow loop with position and pressure, and with about "
            f"{fewest} samples at least on either way through the middle of the travel, so nothing measured is shown"
        )
    return tuple(notes)


def _measured(study: Study, sources: list[TraceSource], model: vgtjax.AbstractModel) -> dict[str, MeasuredLoops]:
    """Loops by unit of all traces that are such."""
    bounds = start_values(model, study.parameters)[1]
    points = OPERATING_POINTS if study.experiments.turbine_pressure is None else study.experiments.turbine_pressure
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
        measured_at = {at for loops in measured.values() for at in loops.turbine_pressures}
        # Gas that acts on nothing gives the same loop at every pressure.
        pressures = sorted(measured_at or set(OPERATING_POINTS)) if feels_gas(model) else [0.0]
    loop = SlowLoop(tuple(pressures), table.loop_seconds, table.loop_duty)
    if not table.steps:
        return (loop,)
    return loop, StepResponse.around(model, tuple(table.steps), table.step_seconds)
