"""The plants of closed loops, and what a controller is told of them."""

from collections import Counter

import numpy as np

import vgtjax
from vgtjax import InputError
from vgtjax.plants import AbstractPlant
from vgtjax.population import Members

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
        if not rest and len(chosen) < len(names):
            note = ("control.unseen.plants is 0, so gains are tried on the units that they are tuned on",)
        elif not rest:
            note = ("gains are tuned on all units, so they are tried on the same ones",)
        elif belief_of(study, actuators) == "population":
            note = ("the controller believes in the mean of all fitted units, with those that its gains are tried on",)
        tuned_on = {name: model for name, model in actuators.fitted.items() if name in chosen}
        return tuned_on, {name: actuators.fitted[name] for name in rest} or tuned_on, note
    if is_alone(study, actuators):
        alone = {"nominal": actuators.population.model}
        return alone, alone, ("the study states no [population], so gains are tuned and tried on one actuator",)
    members = actuators.population.members(table.plants + table.unseen.plants, table.seed)
    tuned_on = {name: members.models[name] for name in members.names[: table.plants] if name in members.models}
    tried = {name: model for name, model in members.models.items() if name not in members.names[: table.plants]}
    if not tuned_on:
        raise _none_physical(_notes(members))
    return tuned_on, tried or members.models, _notes(members)


def all_plants(study: Study, actuators: Actuators) -> tuple[Plants, tuple[str, ...]]:
    """Plants whose loops are closed: the first fitted units, drawn ones, or the study's own; and what is to be said."""
    table = study.control
    if actuators.fitted:
        count = table.plants if "plants" in table.model_fields_set else len(actuators.fitted)
        return dict(list(actuators.fitted.items())[:count]), ()
    if is_alone(study, actuators):
        return {"nominal": actuators.population.model}, ()
    members = actuators.population.members(table.plants, table.seed)
    if not members.models:
        raise _none_physical(_notes(members))
    return members.models, _notes(members)


def is_alone(study: Study, actuators: Actuators) -> bool:
    """Whether a study is about one actuator."""
    return not actuators.fitted and "population" not in study.model_fields_set


def belief_of(study: Study, actuators: Actuators) -> str:
    """What the study, or else its plants, let the controller know: one of [`BELIEFS`][]."""
    return study.control.belief or ("plant" if is_alone(study, actuators) else "population")


def as_plant(model: vgtjax.AbstractModel) -> AbstractPlant:
    """A model of a study with `[control]`, which asks for the full one."""
    assert isinstance(model, AbstractPlant)
    return model


def believed_model(study: Study, actuators: Actuators) -> AbstractPlant:
    """The one actuator that a controller for all plants believes in.

    **Raises:** `InputError` where the study wants it to know each of several plants.
    """
    belief = belief_of(study, actuators)
    if belief == "plant" and not is_alone(study, actuators):
        raise StudyError(
            "a controller that is tuned for several plants must have one belief, but control.belief is 'plant'; use "
            "'population' or 'printed'"
        )
    return vgtjax.Actuator() if belief == "printed" else as_plant(actuators.population.model)


def _notes(members: Members) -> tuple[str, ...]:
    """What is to be said of drawn plants that can't exist."""
    lost = Counter(members.refused.values())
    return tuple(f"in {count} of {len(members.names)} drawn plants {why}{LEFT_OUT}" for why, count in lost.items())


def _none_physical(notes: tuple[str, ...]) -> InputError:
    why = " and ".join(note.removesuffix(LEFT_OUT) for note in notes)
    return StudyError(f"gains need a plant that is physical, but {why}; narrow the spreads under [population]")
