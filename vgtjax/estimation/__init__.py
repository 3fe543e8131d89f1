"""Estimation: exact Jacobians, weighted residuals, Levenberg-Marquardt, and what the data can tell."""

from ._calibration import Calibration as Calibration
from ._calibrator import (
    Calibrator as Calibrator,
    asked_first as asked_first,
    calibrate as calibrate,
    foreseen as foreseen,
    foreseen_certificate as foreseen_certificate,
    start_calibration as start_calibration,
    starting as starting,
)
from ._comparison import Comparison as Comparison, TraceResult as TraceResult, compare as compare
from ._estimate import Estimate as Estimate, estimate_table as estimate_table
from ._found import MEETS as MEETS, found_besides as found_besides, traces_met as traces_met
from ._least_squares import (
    FAINT as FAINT,
    NORMAL_95 as NORMAL_95,
    NULL as NULL,
    VAGUE as VAGUE,
    LeastSquares as LeastSquares,
    clustered_errors as clustered_errors,
    clustered_gram as clustered_gram,
    determined_within as determined_within,
    error_factor as error_factor,
    estimate_uncertainty as estimate_uncertainty,
    huber_weights as huber_weights,
    least_squares as least_squares,
    reduce_rows as reduce_rows,
)
from ._task import Task as Task, plan_task as plan_task
from .derivatives import (
    CHANNELS as CHANNELS,
    SEGMENT as SEGMENT,
    Bundle as Bundle,
    Computation as Computation,
    Evaluated as Evaluated,
    Evaluation as Evaluation,
    Question as Question,
    ask as ask,
    bundle_traces as bundle_traces,
    compiling_ahead as compiling_ahead,
    jacobian as jacobian,
    longest_like as longest_like,
    observe as observe,
    run_alone as run_alone,
    run_together as run_together,
    side_by_side as side_by_side,
)
from .diagnostics import (
    BLOCKS as BLOCKS,
    VERDICTS as VERDICTS,
    Around as Around,
    ConfidenceInterval as ConfidenceInterval,
    End as End,
    Linearised as Linearised,
    Profile as Profile,
    Profiles as Profiles,
    Remains as Remains,
    Slice as Slice,
    Slices as Slices,
    Weighed as Weighed,
    find_remains as find_remains,
    look_around as look_around,
    looking_around as looking_around,
    profiling as profiling,
    slicing as slicing,
)
from .errors import (
    Budget as Budget,
    by_gains as by_gains,
    taken_for_exact as taken_for_exact,
    uncertain_gains as uncertain_gains,
)
from .measurements import (
    RECORDED as RECORDED,
    FitProblem as FitProblem,
    FoundDuty as FoundDuty,
    Reading as Reading,
    SensorNoise as SensorNoise,
    SensorsOfTraces as SensorsOfTraces,
    Unknown as Unknown,
    build_fit_problem as build_fit_problem,
    learn_sensors as learn_sensors,
    observe_traces as observe_traces,
    sample_interval as sample_interval,
    sharp_bundles as sharp_bundles,
    white_sensors as white_sensors,
)
from .search import (
    CHI2_TOLERANCE as CHI2_TOLERANCE,
    REACHED as REACHED,
    LevenbergMarquardt as LevenbergMarquardt,
    Point as Point,
    Progress as Progress,
    Report as Report,
    Slopes as Slopes,
    StartEnded as StartEnded,
    first_progress as first_progress,
    misfit_at as misfit_at,
    quiet as quiet,
)
