"""Parts put together: models of the actuator with their states and vector fields."""

from ._actuator import Actuator as Actuator, ActuatorState as ActuatorState
from ._base import AbstractModel as AbstractModel, State as State
from ._knots import on_given_knots as on_given_knots
from ._mechanical import MechanicalActuator as MechanicalActuator
from ._pneumatic import PneumaticActuator as PneumaticActuator
from .reduced import (
    FLOW_MAPS as FLOW_MAPS,
    Capsule as Capsule,
    CapsuleState as CapsuleState,
    FlowMapFit as FlowMapFit,
    PlungerMapActuator as PlungerMapActuator,
    PlungerMapState as PlungerMapState,
    StaticMapActuator as StaticMapActuator,
    fit_flow_map as fit_flow_map,
    judge as judge,
    least_squares as least_squares,
    reduce_to_plunger_map as reduce_to_plunger_map,
    reduce_to_static_map as reduce_to_static_map,
    steady_flow as steady_flow,
)
