"""Bench tests of the rod: spring, mass, friction, and the force of the gas [chapters 2 and 3]."""

from ._axis import better_start as better_start, identify_axis as identify_axis, moves_at_start as moves_at_start
from ._axis_regression import regress_axis as regress_axis
from ._bristles import bristle_force as bristle_force
from ._dahl import identify_dahl as identify_dahl
from ._lugre import identify_lugre as identify_lugre
from ._mechanical_fit import (
    NO_DERIVATIVES as NO_DERIVATIVES,
    ResponseFit as ResponseFit,
    fit_response as fit_response,
    mechanical_fit as mechanical_fit,
)
from ._motion import (
    MotionRecord as MotionRecord,
    mechanical_half as mechanical_half,
    read_motion as read_motion,
    read_motions as read_motions,
)
from ._second_order import identify_mass_and_damping as identify_mass_and_damping
from ._spring import identify_spring as identify_spring
from ._vane_force import identify_vane_map as identify_vane_map, identify_vane_polynomial as identify_vane_polynomial
from ._weak_form import (
    TraceEquations as TraceEquations,
    filter_motion as filter_motion,
    regress_traces as regress_traces,
)
