"""Exhaust gas force on the vanes, on one interface."""

from ._absent import NoVaneForce as NoVaneForce
from ._base import (
    AbstractStatelessVaneForce as AbstractStatelessVaneForce,
    AbstractVaneForce as AbstractVaneForce,
)
from ._map import Direction as Direction, HysteresisMap as HysteresisMap
from ._polynomial import (
    POWERS as POWERS,
    PRINTED as PRINTED,
    ForcePolynomial as ForcePolynomial,
    polynomial_terms as polynomial_terms,
)
from ._speed_map import SpeedMap as SpeedMap
from ._stage import (
    CRANK_RANGE as CRANK_RANGE,
    HIGHEST_PRESSURE as HIGHEST_PRESSURE,
    WHEEL_SPEED as WHEEL_SPEED,
    Linkage as Linkage,
    Stage as Stage,
    no_steady_flow as no_steady_flow,
)
from ._stage_table import StageTable as StageTable, solve_table as solve_table
from ._tables import AbstractVaneMap as AbstractVaneMap
from ._turbine import Turbine as Turbine
