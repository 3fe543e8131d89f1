"""Magnetic force on the converter's plunger, on one interface."""

from ._base import AbstractMagneticForce as AbstractMagneticForce
from ._coil import Coil as Coil
from ._scaled import ScaledForce as ScaledForce
from ._static import StaticForce as StaticForce
