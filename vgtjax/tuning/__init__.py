"""Gains tuned through the gradient of the closed loop, over references, turbine pressures and plants."""

from .admissible import conditions as conditions, conditions_of as conditions_of
from .cases import Case as Case, Cases as Cases, cross_cases as cross_cases
from .gains import gain_names as gain_names
from .objective import TERMS as TERMS, Objective as Objective
from .problem import (
    MEMORIES as MEMORIES,
    CaseCosts as CaseCosts,
    Linearisation as Linearisation,
    Problem as Problem,
    plan_tuning as plan_tuning,
)
from .smoothing import (
    soften as soften,
    soften_cases as soften_cases,
    wanted_widths as wanted_widths,
    widths_of as widths_of,
)
from .tuner import Tuner as Tuner, TuningProgress as TuningProgress, tune as tune
