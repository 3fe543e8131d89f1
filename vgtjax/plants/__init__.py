"""Parts put together: models of the actuator with their states and vector fields."""

from ._actuator import Actuator as Actuator, as_actuator as as_actuator, require_actuator as require_actuator
from ._air_path import (
    AbstractAirPath as AbstractAirPath,
    AbstractConverterPath as AbstractConverterPath,
    AirPath as AirPath,
    AirPathState as AirPathState,
)
from ._base import (
    AbstractDynamics as AbstractDynamics,
    AbstractModel as AbstractModel,
    State as State,
    assemble as assemble,
)
from ._instrumented import (
    Gains as Gains,
    Initial as Initial,
    Instrumented as Instrumented,
    Offsets as Offsets,
    bare as bare,
    rows_along as rows_along,
    tabulated_along as tabulated_along,
)
from ._knots import Moves as Moves, on_given_knots as on_given_knots, on_knots as on_knots, other_knots as other_knots
from ._mechanical import MechanicalActuator as MechanicalActuator
from ._physical import is_physical as is_physical, least_volume as least_volume, require_physical as require_physical
from ._plant import (
    AbstractPlant as AbstractPlant,
    Plant as Plant,
    PlantState as PlantState,
    air_path_of as air_path_of,
    converter_of as converter_of,
    require_converter as require_converter,
)
from ._pneumatic import PneumaticActuator as PneumaticActuator
from ._rod import AbstractRodModel as AbstractRodModel, Rod as Rod, RodState as RodState
from .reduced import *
