"""Margins of many closed loops where the rod slides, up and down."""

import functools
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._lanes import map_rows
from ..control import (
    AbstractController,
    LinearLoop,
    Margins,
    Scenario,
    Sine,
    balanced_at,
    linearise_loop,
    margins,
)
from ..parts import Diaphragm
from ..plants import AbstractModel, AbstractRodModel
from ._cases import Cases
from ._loops import LoopParts, rows_of

SHARE, RATE = 0.3, 2.0
"""Of the travel to either side of its middle, and rad/s: a sine along which the rod never rests in between."""
TIMES = {"falling": np.pi / RATE, "rising": 2 * np.pi / RATE}
"""s; when the rod passes the middle of its travel."""


def sliding_margins(
    controllers: Mapping[str, AbstractController], cases: Cases, *, lanes: int
) -> dict[str, dict[str, Margins]]:
    """Margins of every plant's loop, by the plant's name and whether the rod is `rising` or `falling`.

    The loop is linearised where the rod passes the middle of its travel, or of the printed one where it has no stops,
    along a slow sine, at the turbine and reservoir pressures of the plant's last case, without noise and
    disturbances.

    **Arguments:** as those of [`close_loops`][], with a controller for each plant.
    """
    last = {label.plant: place for place, label in enumerate(cases.labels)}
    names = list(last)
    at = rows_of(controllers, cases.take(list(last.values())))
    found = map_rows(functools.partial(_linearise, cases.period), at, len(names), min(lanes, len(names)))
    transition, entry, exit_ = found
    return {
        name: {
            way: margins(LinearLoop(transition[row, place], entry[row, place], exit_[row, place], cases.period))
            for place, way in enumerate(TIMES)
        }
        for row, name in enumerate(names)
    }


@eqx.filter_jit
def _linearise(period: float, rows: LoopParts) -> tuple[Any, ...]:
    """Matrices of every lane's loops; the first axis is that of lanes, the second that of times."""

    def lane(controller: AbstractController, plant: AbstractModel, scenario: Scenario) -> tuple[Any, ...]:
        assert isinstance(plant, AbstractRodModel), "margins are those of a rod that slides"
        loops = linearise_loop(plant, controller, _slide(plant, scenario), list(TIMES.values()), period=period)
        return loops.transition, loops.entry, loops.exit

    return jax.vmap(lane)(*rows)


def _slide(plant: AbstractRodModel, scenario: Scenario) -> Scenario:
    """Along the sine, from its middle."""
    travel = jnp.where(jnp.isfinite(plant.diaphragm.travel), plant.diaphragm.travel, Diaphragm().travel)
    start = eqx.tree_at(lambda s: s.position, balanced_at(0.0), 0.5 * travel)
    return eqx.tree_at(
        lambda s: (s.reference, s.start), scenario, (Sine(SHARE * travel, jnp.asarray(RATE), 0.5 * travel), start)
    )
