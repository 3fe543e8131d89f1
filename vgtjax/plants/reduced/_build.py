"""From the full model to a reduced one."""

from typing import Any

from ..._errors import InputError
from ...parts import AbstractFlowMap, AbstractLiftMap, IsothermalChamber
from .._actuator import Actuator
from ._fitting import fit_flow_map
from ._plunger_map import PlungerMapActuator
from ._static_map import StaticMapActuator

FlowMap = AbstractLiftMap | AbstractFlowMap


def _common(model: Actuator) -> dict[str, Any]:
    """The parts that a reduced model takes over; line and heat are what it leaves out."""
    return {
        "chamber": IsothermalChamber(volume=model.chamber.volume),
        "diaphragm": model.diaphragm,
        "friction": model.friction,
        "vane_force": model.vane_force,
        "air": model.air,
    }


def reduce_to_plunger_map(model: Actuator, flow_map: FlowMap | None = None) -> PlungerMapActuator:
    """The model with six states [5.2] of a full actuator.

    **Arguments:** `flow_map`: over plunger position and pressure, by default fitted to `model`.

    **Raises:** `InputError` for a map over duty.
    """
    found = fit_flow_map(model, "lift-table").flow_map if flow_map is None else flow_map
    if not isinstance(found, AbstractLiftMap):
        raise InputError(
            f"the model with six states needs a map over plunger position, but this is a {type(found).__name__}; "
            "fit one of kind 'lift-table'"
        )
    return PlungerMapActuator(flow_map=found, converter=model.converter, **_common(model))


def reduce_to_static_map(model: Actuator, flow_map: FlowMap | None = None) -> StaticMapActuator:
    """The model with four states [5.4] of a full actuator.

    **Arguments:** `flow_map`: over duty and pressure, by default the steady plunger's, fitted to `model`.

    **Raises:** `InputError` for a map over plunger position.
    """
    found = fit_flow_map(model).flow_map if flow_map is None else flow_map
    if not isinstance(found, AbstractFlowMap):
        raise InputError(
            f"the model with four states needs a map over duty, but this is a {type(found).__name__}; fit one of kind "
            "'steady-plunger' or 'polynomial'"
        )
    return StaticMapActuator(flow_map=found, **_common(model))
