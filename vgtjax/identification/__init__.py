"""Identification of each part by its own bench test, as in chapters 2 and 3."""

from ._filters import has_gas as has_gas
from ._fit import fit as fit, plan_fit as plan_fit, start_fit as start_fit, starting_fit as starting_fit
from ._limits import LIMITS as LIMITS, Limit as Limit
from ._pipeline import apply as apply, identify as identify, plan as plan
from ._result import Curve as Curve, Identified as Identified, NotPossible as NotPossible
from .mechanical import (
    identify_axis as identify_axis,
    identify_dahl as identify_dahl,
    identify_lugre as identify_lugre,
    identify_mass_and_damping as identify_mass_and_damping,
    identify_spring as identify_spring,
    identify_vane_map as identify_vane_map,
    identify_vane_polynomial as identify_vane_polynomial,
)
from .pneumatic import (
    identify_flow_areas as identify_flow_areas,
    identify_magnetic_force as identify_magnetic_force,
    identify_plunger as identify_plunger,
)
from .structures import (
    Ahead as Ahead,
    Begin as Begin,
    Compared as Compared,
    Duel as Duel,
    RankedStructure as RankedStructure,
    Structure as Structure,
    StructureRanking as StructureRanking,
    compare_structures as compare_structures,
    comparing_structures as comparing_structures,
    nothing_ahead as nothing_ahead,
    worst_verdict as worst_verdict,
)
