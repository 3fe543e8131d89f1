"""Bench tests in simulation: what drives the actuator, and what is read off its response."""

from ._base import (
    AbstractExperiment as AbstractExperiment,
    Output as Output,
    stack_runs as stack_runs,
)
from ._loops import (
    POSITIONS as POSITIONS,
    HysteresisLoop as HysteresisLoop,
    find_ends as find_ends,
    find_loop as find_loop,
)
from ._measured import SAME_POINT as SAME_POINT, MeasuredLoops as MeasuredLoops, measure_loops as measure_loops
from ._slow_loop import SHOWN as SHOWN, SlowLoop as SlowLoop, label as label
from ._standard_runs import STANDARD_RUNS as STANDARD_RUNS, StandardRun as StandardRun
from ._step_response import StepResponse as StepResponse
from ._validation import (
    Deviation as Deviation,
    Validation as Validation,
    deviation as deviation,
    validate as validate,
    validation_traces as validation_traces,
)
