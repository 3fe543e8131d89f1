"""Magnetic force on the converter's plunger, on one interface."""

from .base import AbstractMagneticForce as AbstractMagneticForce
from .coil import Coil as Coil
from .static import StaticForce as StaticForce
