"""Margins of closed loops, for summaries and for the terminal."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from vgtjax.control import Margins

from .files import finite

PlantMargins = Mapping[str, Mapping[str, Margins]]
"""By a plant's name, and by the way of its rod."""


def list_margins(margins: PlantMargins) -> list[dict[str, Any]]:
    """A row for each plant and way of its rod; figures of a loop that is not stable are none."""
    return [
        {"plant": plant, "rod": way, "stable": found.stable, **finite(dataclasses.asdict(found))}
        for plant, ways in margins.items()
        for way, found in ways.items()
    ]


def least_margins(margins: PlantMargins) -> str:
    """The least of all loops in a line."""
    found = [each for ways in margins.values() for each in ways.values()]
    unstable = sum(not each.stable for each in found)
    stable = [each for each in found if each.stable]

    def least(name: str) -> float:
        return min((getattr(each, name) for each in stable), default=math.nan)

    said = (
        f"least margins: gain {least('gain'):.3g}, phase {least('phase'):.3g} deg, delay {1e3 * least('delay'):.3g} ms"
    )
    if not unstable:
        return said
    return (
        f"{said}; {unstable} of {len(found)} linearised loops are not stable: tune with a duty that arrives late "
        "(duty_delay under [control])"
    )
