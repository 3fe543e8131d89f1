"""Quasi-one-dimensional flow of exhaust gas through a turbine's variable nozzle, and its moment on the vanes (3.5)."""

from ._gas import GAS_CONSTANT as GAS_CONSTANT, GAS_GAMMA as GAS_GAMMA, Gas as Gas
from ._losses import (
    AbstractLoss as AbstractLoss,
    AinleyMathieson as AinleyMathieson,
    Angles as Angles,
    Blading as Blading,
    GivenLoss as GivenLoss,
    Range as Range,
    Soderberg as Soderberg,
)
from ._march import unsteady as unsteady
from ._newton import Ending as Ending
from ._nozzle import CELLS as CELLS, VANES as VANES, WHEEL as WHEEL, Losses as Losses, Nozzle as Nozzle
from ._passage import Inlet as Inlet, Passage as Passage
from ._riemann import States as States
from ._rotor import Rotor as Rotor
from ._steady import (
    PassageFlow as PassageFlow,
    first_guess as first_guess,
    steady as steady,
    steady_near as steady_near,
)
from ._steppers import AbstractStepper as AbstractStepper, Explicit as Explicit, Implicit as Implicit
