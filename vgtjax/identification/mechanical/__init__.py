"""Bench tests of the rod: spring, mass, friction, and the force of the gas [chapters 2 and 3]."""

from ._axis import better_start as better_start, identify_axis as identify_axis, moves_at_start as moves_at_start
from ._dahl import identify_dahl as identify_dahl
from ._lugre import identify_lugre as identify_lugre
from ._mechanical_fit import foreseen_response as foreseen_response, mechanical_fit as mechanical_fit
from ._second_order import identify_mass_and_damping as identify_mass_and_damping
from ._spring import identify_spring as identify_spring
from ._vane_force import identify_vane_map as identify_vane_map, identify_vane_polynomial as identify_vane_polynomial
