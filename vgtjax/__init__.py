"""Differentiable model of an electro-pneumatic actuator for variable geometry turbochargers."""

from .actuator import Actuator as Actuator, ActuatorState as ActuatorState
from .air import Air as Air, flow_function as flow_function, orifice_flow as orifice_flow
from .bench_file import load_trace as load_trace
from .chamber import (
    AbstractChamber as AbstractChamber,
    AdiabaticChamber as AdiabaticChamber,
    IsothermalChamber as IsothermalChamber,
    WallChamber as WallChamber,
)
from .converter import Converter as Converter
from .diaphragm import Diaphragm as Diaphragm
from .errors import InputError as InputError, SimulationError as SimulationError
from .estimation import jacobian as jacobian
from .friction import (
    AbstractFriction as AbstractFriction,
    AdaptiveLuGre as AdaptiveLuGre,
    Coulomb as Coulomb,
    Dahl as Dahl,
    Karnopp as Karnopp,
    LuGre as LuGre,
    PassiveLuGre as PassiveLuGre,
    PassivityWarning as PassivityWarning,
)
from .heun import StabilisedHeun as StabilisedHeun
from .integrate import AdaptiveStep as AdaptiveStep, FixedStep as FixedStep
from .line import (
    AbstractLine as AbstractLine,
    DelayLine as DelayLine,
    NoLine as NoLine,
    WaveLine as WaveLine,
)
from .magnetic_force import AbstractMagneticForce as AbstractMagneticForce, Coil as Coil
from .mechanical import MechanicalActuator as MechanicalActuator
from .model import AbstractModel as AbstractModel
from .parameters import (
    Parameter as Parameter,
    Selection as Selection,
    get_parameter as get_parameter,
    parameter as parameter,
    parameter_table as parameter_table,
    replace_parameters as replace_parameters,
    select as select,
)
from .pneumatic import PneumaticActuator as PneumaticActuator
from .reduced import (
    FlowMapFit as FlowMapFit,
    PlungerMapActuator as PlungerMapActuator,
    StaticMapActuator as StaticMapActuator,
    fit_flow_map as fit_flow_map,
    reduce_to_plunger_map as reduce_to_plunger_map,
    reduce_to_static_map as reduce_to_static_map,
)
from .runtime import configure as configure
from .simulate import RESULTS as RESULTS, Solution as Solution, simulate as simulate
from .trace import Trace as Trace
from .vane_force import (
    AbstractVaneForce as AbstractVaneForce,
    ForcePolynomial as ForcePolynomial,
    HysteresisMap as HysteresisMap,
    NoVaneForce as NoVaneForce,
)
from .vanes import Crank as Crank
