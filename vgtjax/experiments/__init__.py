"""Bench tests in simulation: what drives the actuator, and what is read off its response."""

from .base import AbstractExperiment as AbstractExperiment, Output as Output, stack_runs as stack_runs
from .measured import MeasuredLoops as MeasuredLoops, measure_loops as measure_loops
from .slow_loop import SlowLoop as SlowLoop, label as label
from .step_response import StepResponse as StepResponse, nominal_target as nominal_target
