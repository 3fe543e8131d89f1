"""Models for control: fewer states, and the flow into the chamber as a map [5.2, 5.4]."""

from ._fitting import (
    FlowMapFit as FlowMapFit,
    assess_flow_map as assess_flow_map,
    fit_flow_map as fit_flow_map,
    steady_flow as steady_flow,
)
from ._plunger_map import (
    LiftMapPath as LiftMapPath,
    PlungerMapActuator as PlungerMapActuator,
    reduce_to_plunger_map as reduce_to_plunger_map,
)
from ._polynomial_fit import fit_polynomial_flow as fit_polynomial_flow
from ._static_map import (
    FlowMapPath as FlowMapPath,
    StaticMapActuator as StaticMapActuator,
    reduce_to_static_map as reduce_to_static_map,
)
