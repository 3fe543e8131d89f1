"""Identification of each part by its own bench test, as in chapters 2 and 3."""

from ._axis import better_start as better_start, identify_axis as identify_axis, moves_at_start as moves_at_start
from ._axis_regression import regress_axis as regress_axis
from ._bristles import bristle_force as bristle_force
from ._chamber_flow import read_chamber as read_chamber
from ._dahl import identify_dahl as identify_dahl
from ._filters import (
    has_gas as has_gas,
    holds as holds,
    sensor_offset as sensor_offset,
    slow_blocks as slow_blocks,
    smooth as smooth,
)
from ._fit import fit as fit, plan_fit as plan_fit, start_fit as start_fit, starting_fit as starting_fit
from ._flow_areas import identify_flow_areas as identify_flow_areas, plunger_lift as plunger_lift
from ._flow_map import fit_measured_flow as fit_measured_flow, measured_flow as measured_flow
from ._limits import LIMITS as LIMITS, Limit as Limit
from ._lugre import identify_lugre as identify_lugre
from ._magnetic_force import identify_magnetic_force as identify_magnetic_force
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
from ._pipeline import apply as apply, identify as identify, plan as plan
from ._plunger import identify_plunger as identify_plunger
from ._ranking import Duel as Duel, Ranking as Ranking, Row as Row, rank as rank, worst_verdict as worst_verdict
from ._result import Curve as Curve, Identified as Identified, NotPossible as NotPossible
from ._second_order import identify_mass_and_damping as identify_mass_and_damping
from ._spring import identify_spring as identify_spring
from ._structures import (
    Ahead as Ahead,
    Begin as Begin,
    Compared as Compared,
    Structure as Structure,
    compare_structures as compare_structures,
    comparing_structures as comparing_structures,
    nothing_ahead as nothing_ahead,
)
from ._vane_force import identify_vane_map as identify_vane_map, identify_vane_polynomial as identify_vane_polynomial
from ._weak_form import (
    TraceEquations as TraceEquations,
    filter_motion as filter_motion,
    regress_traces as regress_traces,
)
