"""Physical parts, each an equinox module with its equations."""

from .._types import Scalar as Scalar
from ._air import Air as Air, flow_function as flow_function, orifice_flow as orifice_flow
from ._converter import (
    GENTLE_OPENING as GENTLE_OPENING,
    Converter as Converter,
    ConverterState as ConverterState,
    Flow as Flow,
    Plunger as Plunger,
    without_chatter as without_chatter,
)
from ._diaphragm import Body as Body, Diaphragm as Diaphragm
from ._gas_effect import feels_gas as feels_gas
from ._gas_table import AbstractGasTables as AbstractGasTables, bilinear as bilinear
from ._vanes import Crank as Crank, Vanes as Vanes
from .chamber import (
    AbstractChamber as AbstractChamber,
    AdiabaticChamber as AdiabaticChamber,
    Gas as Gas,
    IsothermalChamber as IsothermalChamber,
    WallChamber as WallChamber,
)
from .flow_map import (
    FULL_DUTY as FULL_DUTY,
    AbstractFlowMap as AbstractFlowMap,
    AbstractLiftMap as AbstractLiftMap,
    LiftTable as LiftTable,
    PolynomialFlow as PolynomialFlow,
    PrintedFlow as PrintedFlow,
    SteadyPlungerFlow as SteadyPlungerFlow,
    duty_by_bisection as duty_by_bisection,
    falling_root as falling_root,
)
from .friction import (
    AbstractFriction as AbstractFriction,
    AbstractLuGre as AbstractLuGre,
    AdaptiveLuGre as AdaptiveLuGre,
    Bristle as Bristle,
    Contact as Contact,
    Coulomb as Coulomb,
    Dahl as Dahl,
    Karnopp as Karnopp,
    LuGre as LuGre,
    PassiveLuGre as PassiveLuGre,
    PassivityWarning as PassivityWarning,
)
from .line import (
    TURBULENT as TURBULENT,
    AbstractLine as AbstractLine,
    DelayLine as DelayLine,
    NoLine as NoLine,
    WaveLine as WaveLine,
    friction_rate as friction_rate,
    resistance as resistance,
    speed_of_sound as speed_of_sound,
)
from .magnetic_force import AbstractMagneticForce as AbstractMagneticForce, Coil as Coil, StaticForce as StaticForce
from .vane_force import (
    POWERS as POWERS,
    PRINTED as PRINTED,
    AbstractVaneForce as AbstractVaneForce,
    Direction as Direction,
    ForcePolynomial as ForcePolynomial,
    HysteresisMap as HysteresisMap,
    NoVaneForce as NoVaneForce,
    polynomial_terms as polynomial_terms,
)
