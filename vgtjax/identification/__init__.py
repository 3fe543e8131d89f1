"""Identification of each part by its own bench test, as in chapters 2 and 3."""

from .pipeline import apply as apply, identify as identify, plan as plan
from .result import Curve as Curve, Identified as Identified
from .vane_force import (
    identify_vane_map as identify_vane_map,
    identify_vane_polynomial as identify_vane_polynomial,
)
