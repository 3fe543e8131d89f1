"""Traces simulated side by side, in batches and in segments, and their exact derivatives."""

from ._bundle import (
    CHANNELS as CHANNELS,
    Bundle as Bundle,
    bundle_traces as bundle_traces,
    longest_like as longest_like,
)
from ._evaluation import (
    Computation as Computation,
    Evaluated as Evaluated,
    Evaluation as Evaluation,
    ask as ask,
    side_by_side as side_by_side,
)
from ._layout import SEGMENT as SEGMENT
from ._mean_columns import Believed as Believed, Columns as Columns, mean_columns as mean_columns
from ._programs import (
    WIDE as WIDE,
    Question as Question,
    compiling_ahead as compiling_ahead,
    run_alone as run_alone,
    run_together as run_together,
)
from ._sensitivities import (
    jacobian as jacobian,
    observe as observe,
    observe_with_jacobian as observe_with_jacobian,
)
from ._steps import StepsOfFit as StepsOfFit, lengthens as lengthens
