"""The plants of closed loops, and what a controller is told of them."""

from collections import Counter
from typing import Any

import numpy as np

import vgtjax
from vgtjax import InputError, SimulationError
from vgtjax.parts import has_tables
from vgtjax.plants import is_physical
from vgtjax.population import Population, SobolSample

from ..population import Actuators
from ..study.places import StudyError
from ..study.tables import Study

Plants = dict[str, vgtjax.AbstractModel]
BELIEFS = {
    "printed": "the printed actuator, without vane force",
    "population": "the middle of the population",
    "plant": "its plant exactly",
}
"""What a controller knows of its plant, by the name that a study gives it."""
NO_TABLE = {InputError: "the nozzle does not work", SimulationError: "no steady flow is found through the nozzle"}
"""Why a drawn plant has no vane force."""
LEFT_OUT = "; they are left out"
"""What follows on why plants are none."""


def choose_plants(study: Study, actuators: Actuators) -> tuple[Plants, Plants, tuple[str, ...]]:
    """Plants that gains are tuned on, plants that they are tried on, and what is to be said of the choice."""
    table = study.control
    if actuators.fitted:
        names = list(actuators.fitted)
        chosen = {names[round(i)] for i in np.linspace(0, len(names) - 1, min(table.plants, len(names)))}
        rest = [name for name in names if name not in chosen][: table.unseen.plants]
        note: tuple[str, ...] = ()
        if not rest:
            note = ("gains are tuned on all units, so they are tried on the same ones",)
        elif belief_of(study, actuators) == "population":
            note = ("the controller believes in the mean of all fitted units, with those that its gains are tried on",)
        tuned_on = {name: model for name, model in actuators.fitted.items() if name in chosen}
        return tuned_on, {name: actuators.fitted[name] for name in rest} or tuned_on, note
    if is_alone(study, actuators):
        alone = {"nominal": actuators.population.model}
        return alone, alone, ("the study states no [population], so gains are tuned and tried on one actuator",)
    drawn, possible, notes = _draw(study, actuators, table.plants + table.unseen.plants)
    tuned_on = {name: possible[name] for name in drawn[: table.plants] if name in possible}
    tried = {name: possible[name] for name in drawn[table.plants :] if name in possible}
    if not tuned_on:
        raise _none_physical(notes)
    return tuned_on, tried or possible, notes


def all_plants(study: Study, actuators: Actuators) -> tuple[Plants, tuple[str, ...]]:
    """Plants whose loops are closed: the first fitted units, drawn ones, or the study's own; and what is to be said."""
    table = study.control
    if actuators.fitted:
        count = table.plants if "plants" in table.model_fields_set else len(actuators.fitted)
        return dict(list(actuators.fitted.items())[:count]), ()
    if is_alone(study, actuators):
        return {"nominal": actuators.population.model}, ()
    _, possible, notes = _draw(study, actuators, table.plants)
    if not possible:
        raise _none_physical(notes)
    return possible, notes


def is_alone(study: Study, actuators: Actuators) -> bool:
    """Whether a study is about one actuator."""
    return not actuators.fitted and "population" not in study.model_fields_set


def belief_of(study: Study, actuators: Actuators) -> str:
    """What the study, or else its plants, let the controller know: one of [`BELIEFS`][]."""
    return study.control.belief or ("plant" if is_alone(study, actuators) else "population")


def believed_model(study: Study, actuators: Actuators) -> vgtjax.AbstractModel:
    """The one actuator that a controller for all plants believes in.

    **Raises:** `InputError` where the study wants it to know each of several plants.
    """
    belief = belief_of(study, actuators)
    if belief == "plant" and not is_alone(study, actuators):
        raise StudyError(
            "a controller that is tuned for several plants must have one belief, but control.belief is 'plant'; use "
            "'population' or 'printed'"
        )
    return vgtjax.Actuator() if belief == "printed" else actuators.population.model


def _draw(study: Study, actuators: Actuators, count: int) -> tuple[list[str], Plants, tuple[str, ...]]:
    """Names of so many drawn plants, those of them that are physical, and notes on the others."""
    population = actuators.population
    rows = population.values(SobolSample(population.dimensions, count, study.control.seed).points(0, count))
    drawn = {f"sample {i}": _built(population, row) for i, row in enumerate(rows)}
    possible = {name: model for name, (model, why) in drawn.items() if why is None}
    lost = Counter(why for _, why in drawn.values() if why is not None)
    notes = [f"in {count} of {len(drawn)} drawn plants {why}{LEFT_OUT}" for why, count in lost.items()]
    return list(drawn), possible, tuple(notes)


def _built(population: Population, row: np.ndarray) -> tuple[Any, str | None]:
    """A drawn plant, and why it is none, if so."""
    try:
        model = population.factors.unpack(population.model, row)
    except (InputError, SimulationError) as error:
        if not has_tables(population.model):
            raise
        return None, NO_TABLE[type(error)]
    return model, None if is_physical(model) else "the diaphragm swallows the chamber"


def _none_physical(notes: tuple[str, ...]) -> InputError:
    why = " and ".join(note.removesuffix(LEFT_OUT) for note in notes)
    return StudyError(f"gains need a plant that is physical, but {why}; narrow the spreads under [population]")
