"""Differentiable model of an electro-pneumatic actuator for variable geometry turbochargers."""

import importlib
import importlib.metadata
import typing

from . import (
    parameters as parameters,
    parts as parts,
    plants as plants,
    simulation as simulation,
    traces as traces,
)
from ._errors import InputError as InputError, SimulationError as SimulationError
from ._runtime import configure as configure
from .parameters import (
    Parameter as Parameter,
    Selection as Selection,
    get_parameter as get_parameter,
    parameter as parameter,
    parameter_table as parameter_table,
    replace_parameters as replace_parameters,
    select as select,
)
from .parts import (
    AbstractChamber as AbstractChamber,
    AbstractFriction as AbstractFriction,
    AbstractLine as AbstractLine,
    AbstractMagneticForce as AbstractMagneticForce,
    AbstractVaneForce as AbstractVaneForce,
    AdaptiveLuGre as AdaptiveLuGre,
    AdiabaticChamber as AdiabaticChamber,
    Air as Air,
    Coil as Coil,
    Converter as Converter,
    Coulomb as Coulomb,
    Crank as Crank,
    Dahl as Dahl,
    DelayLine as DelayLine,
    Diaphragm as Diaphragm,
    ForcePolynomial as ForcePolynomial,
    HysteresisMap as HysteresisMap,
    IsothermalChamber as IsothermalChamber,
    Karnopp as Karnopp,
    LuGre as LuGre,
    NoLine as NoLine,
    NoVaneForce as NoVaneForce,
    PassiveLuGre as PassiveLuGre,
    PassivityWarning as PassivityWarning,
    SpeedMap as SpeedMap,
    Turbine as Turbine,
    WallChamber as WallChamber,
    WaveLine as WaveLine,
    chamber as chamber,
    flow_function as flow_function,
    flow_map as flow_map,
    friction as friction,
    line as line,
    magnetic_force as magnetic_force,
    orifice_flow as orifice_flow,
    vane_force as vane_force,
)
from .plants import (
    AbstractModel as AbstractModel,
    Actuator as Actuator,
    FlowMapFit as FlowMapFit,
    MechanicalActuator as MechanicalActuator,
    Plant as Plant,
    PlungerMapActuator as PlungerMapActuator,
    PneumaticActuator as PneumaticActuator,
    StaticMapActuator as StaticMapActuator,
    fit_flow_map as fit_flow_map,
    reduce_to_plunger_map as reduce_to_plunger_map,
    reduce_to_static_map as reduce_to_static_map,
)
from .simulation import (
    RESULTS as RESULTS,
    AdaptiveStep as AdaptiveStep,
    FixedStep as FixedStep,
    Solution as Solution,
    StabilisedHeun as StabilisedHeun,
    simulate as simulate,
)
from .traces import Channel as Channel, Source as Source, Trace as Trace, load_trace as load_trace

__version__ = importlib.metadata.version("vgtjax")

if (
    typing.TYPE_CHECKING
):  # imported when first asked for, below: a simulation needs none of it, and half of the time it takes
    from . import (
        assurance as assurance,
        control as control,
        estimation as estimation,
        exhaust as exhaust,
        experiments as experiments,
        identification as identification,
        population as population,
        sensitivity as sensitivity,
        tuning as tuning,
        turbine as turbine,
    )
    from .estimation import Calibration as Calibration, jacobian as jacobian
    from .identification import fit as fit

_ROOMS = (
    "assurance",
    "control",
    "estimation",
    "exhaust",
    "experiments",
    "identification",
    "population",
    "sensitivity",
    "tuning",
    "turbine",
)
_ROOM_OF = {"Calibration": "estimation", "jacobian": "estimation", "fit": "identification"}


def __getattr__(name: str) -> object:
    """A room, or a name of one, that is imported when it is first asked for."""
    if name in _ROOMS:
        return importlib.import_module(f".{name}", __name__)
    if name in _ROOM_OF:
        return getattr(importlib.import_module(f".{_ROOM_OF[name]}", __name__), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOMS, *_ROOM_OF})
