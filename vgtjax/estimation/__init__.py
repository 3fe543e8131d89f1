"""Estimation: exact Jacobians, weighted residuals, Levenberg-Marquardt, and what the data can tell."""

from .bundle import CHANNELS as CHANNELS, Bundle as Bundle, bundle_traces as bundle_traces
from .calibration import (
    Calibration as Calibration,
    Calibrator as Calibrator,
    Task as Task,
    TraceResult as TraceResult,
    calibrate as calibrate,
    plan_task as plan_task,
    start_calibration as start_calibration,
)
from .fit import LevenbergMarquardt as LevenbergMarquardt, Progress as Progress
from .noise import noise_level as noise_level
from .residuals import Problem as Problem, build_problem as build_problem
from .sensitivities import (
    jacobian as jacobian,
    observe as observe,
    observe_with_jacobian as observe_with_jacobian,
)
from .uncertainty import (
    Uncertainty as Uncertainty,
    estimate_uncertainty as estimate_uncertainty,
    identifiable as identifiable,
)
