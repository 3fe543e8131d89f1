"""From a study to a tuning problem, and to what tuned gains are tried on afterwards."""

import dataclasses
import hashlib
import itertools
import pathlib
from collections.abc import Iterable, Mapping, Sequence

import jax
import numpy as np

import vgtjax
from vgtjax.control import AbstractController, AbstractSignal, TurbinePulsation
from vgtjax.parameters import Bounds, check_bounds
from vgtjax.parts import feels_gas
from vgtjax.plants import AbstractPlant
from vgtjax.tuning import (
    MEMORIES,
    Cases,
    Objective,
    TuningProblem,
    Variant,
    cross_cases,
    plan_tuning,
    soften,
    soften_cases,
)

from ..population import read_actuators
from ..study.base import override
from ..study.control import ControlTable
from ..study.loop_disturbances import build_delays, build_disturbances, build_sensors
from ..study.models import start_values
from ..study.places import OF_A_CONTROLLER, StudyError, of_study, stated
from ..study.read import expand_traces, fingerprint, load_study
from ..study.references import Reference, TraceReference, build_references
from ..study.tables import Study
from ..study.units import StudyJob
from .designs import design_for
from .plants import believed_model, choose_plants, is_alone

EXAMPLE = pathlib.Path(__file__).parents[1] / "example" / "control" / "study.toml"
"""The study that runs when none is named."""
MOST_SAMPLES = 4_000_000
"""Of one run: an hour at 1 ms, of which each recorded signal takes 32 MB a closed loop."""


@dataclasses.dataclass(frozen=True, eq=False)
class TuneJob(StudyJob):
    """Everything that tuning needs.

    `smooth` is what is tuned, with switching laws softened; `true` has the same cases as they are; `unseen` has other
    references, turbine pressures, plants and noise; `believed` is the actuator that the controller is designed for.
    """

    bounds: Bounds
    believed: AbstractPlant
    smooth: TuningProblem
    true: TuningProblem
    unseen: TuningProblem
    notes: tuple[str, ...]


def prepare_tuning(path: pathlib.Path | None, parameters: pathlib.Path | None) -> TuneJob:
    """Reads and checks a study of a controller."""
    path = EXAMPLE if path is None else path
    study = load_study(path)
    if study.model != "full":
        raise StudyError(f"controllers are tuned on model = 'full', but it is '{study.model}'; change it")
    table, folder = study.control, path.parent
    actuators = read_actuators(path, study, parameters)
    believed = believed_model(study, actuators)
    with of_study(), stated(OF_A_CONTROLLER):
        controller, bounds = start_controller(table, believed)
    tuned_on, tried_on, notes = choose_plants(study, actuators)
    references = build_references(table.reference, folder, study.channels)
    cases = cases_of(study, tuned_on, references, table.turbine_pressure, table.seed)
    with of_study(), stated(OF_A_CONTROLLER):
        smooth = _plan(table, soften(controller), soften_cases(cases), bounds)
    references = build_references(table.unseen.reference, folder, study.channels)
    pressures = table.unseen.turbine_pressure or _between(table.turbine_pressure)
    unseen = cases_of(study, tried_on, references, pressures, table.seed + 1)
    notes += gas_notes(table, actuators.first)
    if table.fallback != "none":
        notes += ("gains are tuned without the fallback",)
    followed = [*table.reference, *table.unseen.reference]
    return TuneJob(
        study,
        path.read_text(encoding="utf-8-sig"),
        fingerprint(study, expand_traces(study, folder), actuators.hashed | reference_files(followed, folder)),
        bounds,
        believed,
        smooth,
        dataclasses.replace(smooth, controller=controller, cases=cases),
        dataclasses.replace(smooth, controller=controller, cases=unseen),
        notes if is_alone(study, actuators) else (*actuators.notes, *notes),
    )


def gas_notes(table: ControlTable, plant: vgtjax.AbstractModel) -> tuple[str, ...]:
    """What is to be said of a turbine pressure that the plants do not feel."""
    acts = max(table.turbine_pressure) == 0 or feels_gas(plant)
    return () if acts else ("turbine pressure acts on nothing, as the study's vane_force is 'none'",)


def reference_files(entries: Iterable[Reference], folder: pathlib.Path) -> dict[str | None, dict[str, str]]:
    """What the traces hold that are references, for the fingerprint."""
    files = [entry.file for entry in entries if isinstance(entry, TraceReference)]
    digests = {file: hashlib.sha256((folder / file).read_bytes()).hexdigest() for file in files}
    return {"[[control.reference]]": digests} if digests else {}


def start_controller(table: ControlTable, believed: AbstractPlant) -> tuple[AbstractController, Bounds]:
    """The study's design for an actuator that it believes in, with the gains that the study states, and their bounds.

    **Raises:** `InputError` for gains that the design does not have or allow.
    """
    controller = design_for(table.design, believed, table.period)
    values, bounds = start_values(controller, table.gains)
    controller = vgtjax.replace_parameters(controller, values)
    check_bounds(controller, bounds)
    return controller, bounds


def cases_of(
    study: Study,
    plants: Mapping[str, vgtjax.AbstractModel],
    references: Mapping[str, AbstractSignal],
    pressures: Sequence[float],
    seed: int,
    duration: float | None = None,
) -> Cases:
    """Plants, references, turbine pressures and variants crossed, as the study says; `duration` in s beats its own."""
    table, reservoir = study.control, study.control.reservoir.build()
    duration = table.duration if duration is None else duration
    require_samples(duration, table.period, "duration under [control]", "shorten it")
    _require_vacuum(reservoir, duration, table.period)
    return cross_cases(
        plants,
        references,
        pressures,
        duration=duration,
        period=table.period,
        seed=seed,
        reservoir=reservoir,
        variants=variants_of(study),
    )


def require_samples(seconds: float, period: float, cause: str, remedy: str) -> None:
    """**Raises:** `StudyError` for a run of more samples, `period` in s apart, than memory has room for; `cause` and
    `remedy` say what makes it so long."""
    if seconds / period > MOST_SAMPLES:
        raise StudyError(
            f"a run must have {MOST_SAMPLES:,} samples at most, but {cause} makes it {seconds:g} s long, with a sample "
            f"every {period:g} s; {remedy}, or lengthen period"
        )


def _require_vacuum(reservoir: AbstractSignal, duration: float, period: float) -> None:
    """**Raises:** `StudyError` for a reservoir that comes below vacuum in a run."""
    time = np.arange(round(duration / period) + 1) * period
    pressure = np.asarray(jax.jit(jax.vmap(reservoir))(time))
    lowest = int(np.argmin(pressure))
    if pressure[lowest] < 0:
        raise StudyError(
            f"the reservoir must stay at a pressure of zero or more, but it comes to {pressure[lowest]:g} Pa absolute "
            f"{time[lowest]:g} s into a run of {duration:g} s; correct its drift, which is in Pa/s, or its depth"
        )


def variants_of(study: Study) -> dict[str, Variant]:
    """Sensors and disturbances of the closed loops as the study has them, and of each of its variants."""
    table = study.control
    engines = (TurbinePulsation.of(engine.build()) for engine in (study.pulsation,) if engine is not None)
    shared = (*engines, *build_disturbances(table.disturbance))
    sensors = {"": table.sensor} | {each.name: override(table.sensor, each.sensor) for each in table.variant}
    stated = {each.name: each.duty_delay for each in table.variant if each.duty_delay is not None}
    delays = build_delays(dict.fromkeys(sensors, table.duty_delay) | stated)
    return {name: Variant(build_sensors(table.sensors, sensors[name]), (*shared, *delays[name])) for name in sensors}


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
        lanes=table.lanes,
    )
