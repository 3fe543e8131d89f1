"""Where time advances."""

from ._heun import StabilisedHeun as StabilisedHeun
from ._results import (
    RESULTS as RESULTS,
    HasEnds as HasEnds,
    blame as blame,
    check_result as check_result,
    choose as choose,
    end_of as end_of,
    first_failure as first_failure,
)
from ._simulate import Solution as Solution, march as march, model_dtype as model_dtype, simulate as simulate
from ._stepping import (
    AbstractFixedMarch as AbstractFixedMarch,
    AbstractFixedStepping as AbstractFixedStepping,
    AbstractMarch as AbstractMarch,
    AbstractStepping as AbstractStepping,
    AdaptiveStep as AdaptiveStep,
    CountedMarch as CountedMarch,
    FixedMarch as FixedMarch,
    FixedStep as FixedStep,
    fixed as fixed,
    scan_in_blocks as scan_in_blocks,
)
