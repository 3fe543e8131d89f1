"""Identification of each part by its own bench test, as in chapters 2 and 3."""

from .axis import identify_axis as identify_axis
from .dahl import identify_dahl as identify_dahl
from .flow_areas import identify_flow_areas as identify_flow_areas
from .lugre import identify_lugre as identify_lugre
from .magnetic_force import identify_magnetic_force as identify_magnetic_force
from .mechanical_fit import mechanical_fit as mechanical_fit
from .pipeline import apply as apply, identify as identify, plan as plan
from .plunger import identify_plunger as identify_plunger
from .result import Curve as Curve, Identified as Identified
from .second_order import identify_mass_and_damping as identify_mass_and_damping
from .spring import identify_spring as identify_spring
from .vane_force import (
    identify_vane_map as identify_vane_map,
    identify_vane_polynomial as identify_vane_polynomial,
)
