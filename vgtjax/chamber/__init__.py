"""The diaphragm chamber: ideal gas in a moving volume, on one interface."""

from .adiabatic import AdiabaticChamber as AdiabaticChamber
from .base import AbstractChamber as AbstractChamber, Gas as Gas
from .isothermal import IsothermalChamber as IsothermalChamber
from .wall import WallChamber as WallChamber
