"""The plain mode that a study puts behind its controller."""

import math
from typing import Any

from vgtjax.control import AbstractController, WithFallback
from vgtjax.plants import AbstractPlant

from ..study.loop_disturbances import build_sensors
from ..study.tables import Study

FALLBACK = "static-balance"
"""The only kind there is."""


def fallback_of(study: Study) -> dict[str, Any] | None:
    """What a file of gains says of the fallback; `patience` in s, none for ever."""
    table = study.control
    if table.fallback == "none":
        return None
    # Where the steps of a sensor hide its noise, standing still is no sign of a fault.
    sensor = build_sensors(table.sensors, table.sensor).position
    noisy = sensor.noise > sensor.quantum
    return {"kind": table.fallback, "patience": WithFallback.patience if noisy else None}


def with_fallback(
    said: dict[str, Any] | None, believed: AbstractPlant, controller: AbstractController
) -> AbstractController:
    """The controller behind which the fallback stands that is said, and that believes in the same plant."""
    if said is None:
        return controller
    patience = math.inf if said["patience"] is None else said["patience"]
    return WithFallback.for_plant(believed, controller=controller, patience=patience)
