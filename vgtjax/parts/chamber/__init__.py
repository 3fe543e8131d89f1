"""The diaphragm chamber: ideal gas in a moving volume, on one interface."""

from ._adiabatic import AdiabaticChamber as AdiabaticChamber
from ._base import AbstractChamber as AbstractChamber, GasState as GasState
from ._isothermal import IsothermalChamber as IsothermalChamber
from ._wall import WallChamber as WallChamber
