"""Models for control: fewer states, and the flow into the chamber as a map [5.2, 5.4]."""

from .base import AbstractFlowMap as AbstractFlowMap, AbstractLiftMap as AbstractLiftMap
from .build import reduce_to_plunger_map as reduce_to_plunger_map, reduce_to_static_map as reduce_to_static_map
from .capsule import Capsule as Capsule, CapsuleState as CapsuleState
from .fitting import (
    FLOW_MAPS as FLOW_MAPS,
    FlowMapFit as FlowMapFit,
    fit_flow_map as fit_flow_map,
    steady_flow as steady_flow,
)
from .lift_table import LiftTable as LiftTable
from .plunger_map import PlungerMapActuator as PlungerMapActuator, PlungerMapState as PlungerMapState
from .polynomial import PolynomialFlow as PolynomialFlow
from .printed import PrintedFlow as PrintedFlow
from .static_map import StaticMapActuator as StaticMapActuator
from .steady_plunger import SteadyPlungerFlow as SteadyPlungerFlow
from .validation import (
    Deviation as Deviation,
    Validation as Validation,
    deviation as deviation,
    validate as validate,
    validation_traces as validation_traces,
)
