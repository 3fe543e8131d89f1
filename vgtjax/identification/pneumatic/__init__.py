"""Bench tests of the converter and the chamber [chapter 2]."""

from ._flow_areas import identify_flow_areas as identify_flow_areas
from ._magnetic_force import identify_magnetic_force as identify_magnetic_force
from ._plunger import foreseen_plunger as foreseen_plunger, identify_plunger as identify_plunger
