"""Where time advances."""

from ._heun import StabilisedHeun as StabilisedHeun
from ._simulate import (
    RESULTS as RESULTS,
    Solution as Solution,
    march as march,
    model_dtype as model_dtype,
    simulate as simulate,
)
from ._stepping import (
    UNROLL as UNROLL,
    AbstractStepping as AbstractStepping,
    AdaptiveStep as AdaptiveStep,
    FixedStep as FixedStep,
    scan_in_blocks as scan_in_blocks,
)
