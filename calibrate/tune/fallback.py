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
    patience = WithFallback.patience_with(build_sensors(table.sensors, table.sensor).position)
    return {"kind": table.fallback, "patience": patience if math.isfinite(patience) else None}


def with_fallback(
    said: dict[str, Any] | None, believed: AbstractPlant, controller: AbstractController
) -> AbstractController:
    """The controller behind which the fallback stands that is said, and that believes in the same plant."""
    if said is None:
        return controller
    patience = math.inf if said["patience"] is None else said["patience"]
    return WithFallback.for_plant(believed, controller=controller, patience=patience)
