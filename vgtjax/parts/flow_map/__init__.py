"""Maps of the flow into the chamber over duty or plunger position, on one interface [5.1, 5.3, 5.10, B.4]."""

from ._base import (
    FULL_DUTY as FULL_DUTY,
    AbstractFlowMap as AbstractFlowMap,
    AbstractLiftMap as AbstractLiftMap,
)
from ._lift_table import LiftTable as LiftTable
from ._polynomial import PolynomialFlow as PolynomialFlow
from ._printed import PrintedFlow as PrintedFlow
from ._roots import falling_root as falling_root
from ._steady_plunger import SteadyPlungerFlow as SteadyPlungerFlow
