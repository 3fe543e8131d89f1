"""Models for control: fewer states, and the flow into the chamber as a map [5.2, 5.4]."""

from ._build import reduce_to_plunger_map as reduce_to_plunger_map, reduce_to_static_map as reduce_to_static_map
from ._fitting import (
    FLOW_MAPS as FLOW_MAPS,
    FlowMapFit as FlowMapFit,
    fit_flow_map as fit_flow_map,
    judge as judge,
    steady_flow as steady_flow,
)
from ._least_squares import least_squares as least_squares
from ._plunger_map import LiftMapPath as LiftMapPath, PlungerMapActuator as PlungerMapActuator
from ._static_map import FlowMapPath as FlowMapPath, StaticMapActuator as StaticMapActuator
