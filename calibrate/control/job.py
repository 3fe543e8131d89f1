"""From a study to closed loops of a controller whose gains are given."""

import dataclasses
import pathlib
from typing import Any

import vgtjax
from vgtjax.control import AbstractController, AbstractSignal, check
from vgtjax.plants import AbstractPlant
from vgtjax.tuning import Cases, gain_names

from ..population import Actuators, read_actuators
from ..study.parameter_file import Entry, tabulate
from ..study.places import OF_A_CONTROLLER, StudyError, stated
from ..study.read import expand_traces, fingerprint, load_study
from ..study.references import SineReference, build_references, cycle
from ..study.tables import Study
from ..study.units import StudyJob
from ..tune.fallback import fallback_of, with_fallback
from ..tune.gains_file import note_on_period, note_on_plant, read_gains
from ..tune.job import EXAMPLE, cases_of, gas_notes, reference_files, require_samples, start_controller
from ..tune.plants import BELIEFS, Plants, all_plants, as_plant, belief_of, believed_model, is_alone


@dataclasses.dataclass(frozen=True, eq=False)
class ControlJob(StudyJob):
    """Everything that closing the loops needs.

    `controllers` are one for each plant by its name, all the same unless each knows its own plant, which is what
    `belief` says. `groups` are closed loops that run for one time each: a slow reference takes longer than others.
    """

    controllers: dict[str, AbstractController]
    gains: tuple[Entry, ...]
    """Of the first of them."""
    belief: str
    groups: tuple[Cases, ...]
    notes: tuple[str, ...]


def prepare_control(
    path: pathlib.Path | None, parameters: pathlib.Path | None, gains: pathlib.Path | None
) -> ControlJob:
    """Reads and checks a study of a controller, and its gains where a file gives them."""
    path = EXAMPLE if path is None else path
    study = load_study(path)
    if study.model != "full":
        raise StudyError(f"loops are closed on model = 'full', but it is '{study.model}'; change it")
    actuators = read_actuators(path, study, parameters)
    plants, notes = all_plants(study, actuators)
    with stated(OF_A_CONTROLLER):
        controllers, chosen, given = _controllers(study, actuators, plants, gains)
    groups = _groups(study, plants, path.parent)  # reads the references, and says which one is missing
    hashed = actuators.hashed | reference_files(study.control.reference, path.parent) | {"gains": given}
    belief = BELIEFS[belief_of(study, actuators)]
    of_population = () if is_alone(study, actuators) else actuators.notes
    said = (*of_population, *notes, *gas_notes(study.control, actuators.first), *_on_gains(study, actuators, gains))
    digest = fingerprint(study, expand_traces(study, path.parent), hashed)
    return ControlJob(study, path.read_text(encoding="utf-8-sig"), digest, controllers, chosen, belief, groups, said)


def _controllers(
    study: Study, actuators: Actuators, plants: Plants, gains: pathlib.Path | None
) -> tuple[dict[str, AbstractController], tuple[Entry, ...], dict[str, Any]]:
    """A controller for each plant, the gains of the first, and those of the file, which go before the study's."""
    table = study.control
    if belief_of(study, actuators) == "plant":
        started = {name: start_controller(table, as_plant(plant))[0] for name, plant in plants.items()}
    else:
        started = dict.fromkeys(plants, start_controller(table, believed_model(study, actuators))[0])
    given = {} if gains is None else read_gains(gains, table.design, next(iter(started.values())))
    controllers = {name: vgtjax.replace_parameters(controller, given) for name, controller in started.items()}
    for controller in controllers.values():
        check(controller)
    first = next(iter(controllers.values()))
    chosen = tabulate(first, first, {}, {}, gain_names(first))
    controllers = {name: _guarded(study, actuators, as_plant(plants[name]), each) for name, each in controllers.items()}
    return controllers, tuple(chosen), given


def _on_gains(study: Study, actuators: Actuators, gains: pathlib.Path | None) -> list[str]:
    """What is to be said of a file of gains: of its period, and of its actuator unless every controller knows its own
    plant."""
    if gains is None:
        return []
    knows_each = belief_of(study, actuators) == "plant" and not is_alone(study, actuators)
    on_plant = None if knows_each else note_on_plant(gains, study, believed_model(study, actuators))
    return [note for note in (on_plant, note_on_period(gains, study)) if note is not None]


def _guarded(
    study: Study, actuators: Actuators, plant: AbstractPlant, controller: AbstractController
) -> AbstractController:
    """A controller with the study's fallback, which knows of the plant what the controller does."""
    believed = plant if belief_of(study, actuators) == "plant" else believed_model(study, actuators)
    return with_fallback(fallback_of(study), believed, controller)


def _groups(study: Study, plants: Plants, folder: pathlib.Path) -> tuple[Cases, ...]:
    """Closed loops, those that run for one time together: long enough that a period counts after all has settled."""
    table, signals = study.control, build_references(study.control.reference, folder, study.channels)
    lasting: dict[float, dict[str, AbstractSignal]] = {}
    for entry in table.reference:
        least = cycle(entry) + table.settled if cycle(entry) else 0.0
        if least > table.duration:
            rate = f" of rate {entry.rate:g} rad/s" if isinstance(entry, SineReference) else ""
            cause = f"a period of the reference '{entry.title}'{rate}"
            require_samples(least, table.period, cause, "follow a faster one")
        seconds = max(table.duration, least)
        lasting.setdefault(seconds, {})[entry.title] = signals[entry.title]
    return tuple(
        cases_of(study, plants, along, table.turbine_pressure, table.seed + number, seconds)
        for number, (seconds, along) in enumerate(lasting.items())
    )
