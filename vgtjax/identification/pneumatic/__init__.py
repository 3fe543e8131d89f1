"""Bench tests of the converter and the chamber [chapter 2]."""

from ._chamber_flow import read_chamber as read_chamber
from ._flow_areas import identify_flow_areas as identify_flow_areas, plunger_lift as plunger_lift
from ._flow_map import fit_measured_flow as fit_measured_flow, measured_flow as measured_flow
from ._magnetic_force import identify_magnetic_force as identify_magnetic_force
from ._plunger import identify_plunger as identify_plunger
