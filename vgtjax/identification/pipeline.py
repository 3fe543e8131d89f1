"""The bench tests of chapters 2 and 3 one after the other, each on what the earlier ones found."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from ..model import AbstractModel
from ..parameters import parameter_table, replace_parameters
from ..trace import Trace
from ..vane_force import HysteresisMap
from .result import Identified
from .vane_force import NO_GAS, identify_vane_map, identify_vane_polynomial

Step = Callable[[Any, Sequence[Trace]], Identified]


def plan(model: AbstractModel) -> list[Step]:
    """The identifications that make sense for a model, in an order in which each finds what it builds on."""
    return [identify_vane_map, identify_vane_polynomial]


def identify(model: AbstractModel, traces: Sequence[Trace]) -> Iterator[tuple[Any, Identified]]:
    """Runs every identification of the plan, each on the model that the earlier ones left.

    Yields that model and what was found, one test at a time.
    """
    for step in plan(model):
        found = step(model, traces)
        model = apply(model, found)
        yield model, found


def cold(traces: Sequence[Trace]) -> list[Trace]:
    """Traces without exhaust gas, from which springs and friction are told."""
    return [trace for trace in traces if trace.p_trb is None or np.max(trace.p_trb) <= NO_GAS]


def apply(model: AbstractModel, found: Identified) -> Any:
    """`model` with what an identification found; tables take the knots that it chose."""
    vane_force = getattr(model, "vane_force", None)
    knots = found.values.get("vane_force.turbine_pressure")
    if knots is not None and isinstance(vane_force, HysteresisMap):
        moved = vane_force.on_knots(knots, vane_force.crank_angle)
        model = eqx.tree_at(lambda m: m.vane_force, model, moved)
    known = parameter_table(model)
    return replace_parameters(model, {name: value for name, value in found.values.items() if name in known})
