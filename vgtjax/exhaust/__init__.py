"""The engine whose blow-downs make the pressure at the turbine's inlet pulsate; nothing here was ever measured."""

from ._cycle import Pulsation as Pulsation, pulsation as pulsation, steady_cycle as steady_cycle
from ._disturbance import PressurePulsation as PressurePulsation
from ._engine import Engine as Engine
from ._gas import ExhaustGas as ExhaustGas
from ._operating_point import ASSUMED as ASSUMED, OperatingPoint as OperatingPoint, TurbineFlow as TurbineFlow
from ._valve import Valve as Valve
