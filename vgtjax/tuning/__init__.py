"""Gains tuned through the gradient of the closed loop, over references, turbine pressures and plants."""

from ._admissible import (
    conditions as conditions,
    conditions_asked as conditions_asked,
    gain_names as gain_names,
)
from ._cases import Case as Case, Cases as Cases, Variant as Variant, cross_cases as cross_cases
from ._closed import ClosedLoops as ClosedLoops, Runs as Runs, close_loops as close_loops
from ._loops import Figures as Figures
from ._objective import TERMS as TERMS, Objective as Objective
from ._problem import (
    MEMORIES as MEMORIES,
    CaseCosts as CaseCosts,
    Linearisation as Linearisation,
    TuningProblem as TuningProblem,
    plan_tuning as plan_tuning,
)
from ._quadratic import STEEPEST as STEEPEST
from ._sliding_margins import sliding_margins as sliding_margins
from ._sliding_mode import Sliding as Sliding, sliding as sliding
from ._smoothing import soften as soften, soften_cases as soften_cases, wanted_widths as wanted_widths
from ._tune import TunedGain as TunedGain, Tuning as Tuning, tune as tune
from ._tuner import Tuner as Tuner, TuningProgress as TuningProgress
