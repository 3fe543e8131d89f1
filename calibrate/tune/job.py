"""From a study to a tuning problem, and to what tuned gains are tried on afterwards."""

import dataclasses
import hashlib
import itertools
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

import vgtjax
from vgtjax import InputError
from vgtjax.control import AbstractController, AbstractSignal, Sensors
from vgtjax.parameters import Bounds, check_bounds
from vgtjax.parts import feels_gas
from vgtjax.plants import is_physical
from vgtjax.population import SobolSample
from vgtjax.tuning import MEMORIES, Cases, Objective, TuningProblem, cross_cases, plan_tuning, soften, soften_cases

from ..population import Actuators, read_actuators
from ..study.control import ControlTable
from ..study.models import start_values
from ..study.places import OF_A_CONTROLLER, stated
from ..study.read import expand_traces, fingerprint, load_study
from ..study.references import TraceReference, build_references
from ..study.tables import Study
from ..study.units import StudyJob
from .designs import DESIGNS

EXAMPLE = pathlib.Path(__file__).parents[1] / "example" / "control" / "study.toml"
"""The study that runs when none is named."""


@dataclasses.dataclass(frozen=True, eq=False)
class TuneJob(StudyJob):
    """Everything that tuning needs.

    `smooth` is what is tuned, with switching laws softened; `true` has the same cases as they are; `unseen` has other
    references, turbine pressures, plants and noise; `believed` is the actuator that the controller is designed for.
    """

    bounds: Bounds
    believed: vgtjax.AbstractModel
    smooth: TuningProblem
    true: TuningProblem
    unseen: TuningProblem
    notes: tuple[str, ...]


def prepare_tuning(path: pathlib.Path | None, parameters: pathlib.Path | None) -> TuneJob:
    """Reads and checks a study of a controller."""
    path = EXAMPLE if path is None else path
    study = load_study(path)
    if study.model != "full":
        raise InputError(f"controllers are tuned on model = 'full', but it is '{study.model}'; change it")
    table, folder = study.control, path.parent
    actuators = read_actuators(path, study, parameters)
    nominal: Any = actuators.population.model
    with stated(OF_A_CONTROLLER):
        controller, bounds = _controller(table, nominal)
    tuned_on, tried_on, notes = choose_plants(study, actuators)
    cases = _cases(table, tuned_on, build_references(table.reference, folder), table.turbine_pressure, table.seed)
    with stated(OF_A_CONTROLLER):
        smooth = _plan(table, soften(controller), soften_cases(cases), bounds)
    references = build_references(table.unseen.reference, folder)
    pressures = table.unseen.turbine_pressure or _between(table.turbine_pressure)
    unseen = _cases(table, tried_on, references, pressures, table.seed + 1)
    if max(table.turbine_pressure) > 0 and not feels_gas(nominal):
        notes += ("turbine pressure acts on nothing, as the study's vane_force is 'none'",)
    return TuneJob(
        study,
        path.read_text(encoding="utf-8-sig"),
        fingerprint(study, expand_traces(study, folder), actuators.values | _reference_files(table, folder)),
        bounds,
        nominal,
        smooth,
        dataclasses.replace(smooth, controller=controller, cases=cases),
        dataclasses.replace(smooth, controller=controller, cases=unseen),
        (*actuators.notes, *notes) if "population" in study.model_fields_set else notes,
    )


def _reference_files(table: ControlTable, folder: pathlib.Path) -> dict[str | None, dict[str, str]]:
    """What the traces hold that are references, for the fingerprint."""
    entries = [*table.reference, *table.unseen.reference]
    files = [entry.file for entry in entries if isinstance(entry, TraceReference)]
    digests = {file: hashlib.sha256((folder / file).read_bytes()).hexdigest() for file in files}
    return {"[[control.reference]]": digests} if digests else {}


def _controller(table: ControlTable, nominal: vgtjax.Actuator) -> tuple[AbstractController, Bounds]:
    controller = DESIGNS[table.design].for_plant(nominal)
    values, bounds = start_values(controller, table.gains)
    controller = vgtjax.replace_parameters(controller, values)
    check_bounds(controller, bounds)
    return controller, bounds


def choose_plants(
    study: Study, actuators: Actuators
) -> tuple[dict[str, vgtjax.AbstractModel], dict[str, vgtjax.AbstractModel], tuple[str, ...]]:
    """Plants that gains are tuned on, plants that they are tried on, and what is to be said of the choice."""
    table, population = study.control, actuators.population
    if actuators.fitted:
        names = list(actuators.fitted)
        chosen = {names[round(i)] for i in np.linspace(0, len(names) - 1, min(table.plants, len(names)))}
        rest = [name for name in names if name not in chosen][: table.unseen.plants]
        same = "gains are tuned on all units, so they are tried on the same ones"
        mean = "the controller believes in the mean of all fitted units, with those that its gains are tried on"
        note = (mean if rest else same,)
        tuned_on = {name: model for name, model in actuators.fitted.items() if name in chosen}
        return tuned_on, {name: actuators.fitted[name] for name in rest} or tuned_on, note
    if "population" not in study.model_fields_set:
        alone = {"nominal": population.model}
        return alone, alone, ("the study states no [population], so gains are tuned and tried on one actuator",)
    points = SobolSample(population.dimensions, table.plants + table.unseen.plants, table.seed)
    rows = population.values(points.points(0, table.plants + table.unseen.plants))
    drawn = {f"sample {i}": population.factors.unpack(population.model, row) for i, row in enumerate(rows)}
    possible = {name: model for name, model in drawn.items() if is_physical(model)}
    tuned_on = {name: possible[name] for name in list(drawn)[: table.plants] if name in possible}
    tried = {name: possible[name] for name in list(drawn)[table.plants :] if name in possible}
    if not tuned_on:
        raise InputError(
            f"gains need a plant that is physical, but in none of the {table.plants} drawn does the diaphragm leave "
            "the chamber a volume; narrow the spreads under [population]"
        )
    lost = len(drawn) - len(possible)
    left_out = f"in {lost} of {len(drawn)} drawn plants the diaphragm swallows the chamber; they are left out"
    return tuned_on, tried or possible, (left_out,) * bool(lost)


def _cases(
    table: ControlTable,
    plants: Mapping[str, vgtjax.AbstractModel],
    references: Mapping[str, AbstractSignal],
    pressures: Sequence[float],
    seed: int,
) -> Cases:
    sensors = Sensors.bench() if table.sensors == "bench" else Sensors.ideal()
    timing = {"duration": table.duration, "period": table.period}
    return cross_cases(plants, references, pressures, sensors=sensors, seed=seed, **timing)


def _between(pressures: Sequence[float]) -> list[float]:
    """Pressures between those, and the highest of them."""
    rising = sorted(set(pressures))
    return [*(0.5 * (low + high) for low, high in itertools.pairwise(rising)), rising[-1]]


def _plan(table: ControlTable, controller: AbstractController, cases: Cases, bounds: Bounds) -> TuningProblem:
    return plan_tuning(
        controller,
        cases,
        Objective(**dict(table.cost), settled=table.settled),
        free=table.free,
        fixed=table.fixed,
        bounds=bounds,
        memories=MEMORIES if table.derivative_memory is None else table.derivative_memory,
        lanes=max(jax.device_count(), table.lanes),
    )
