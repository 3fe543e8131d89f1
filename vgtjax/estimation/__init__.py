"""Estimation: exact Jacobians, weighted residuals, Levenberg-Marquardt, and what the data can tell."""

from ._around import (
    Around as Around,
    ConfidenceInterval as ConfidenceInterval,
    look_around as look_around,
    looking_around as looking_around,
)
from ._bands import spread_along as spread_along
from ._beginning import first_progress as first_progress
from ._budget import Budget as Budget
from ._bundle import CHANNELS as CHANNELS, Bundle as Bundle, bundle_traces as bundle_traces
from ._calibration import (
    Calibration as Calibration,
    Comparison as Comparison,
    TraceResult as TraceResult,
    compare as compare,
)
from ._calibrator import (
    Calibrator as Calibrator,
    asked_first as asked_first,
    calibrate as calibrate,
    foreseen as foreseen,
    foreseen_certificate as foreseen_certificate,
    start_calibration as start_calibration,
    starting as starting,
)
from ._corrections import trusted as trusted
from ._duties import RECORDED as RECORDED, Reading as Reading
from ._evaluation import (
    Evaluated as Evaluated,
    Evaluation as Evaluation,
    Steps as Steps,
    ask as ask,
    side_by_side as side_by_side,
)
from ._evidence import (
    Unknown as Unknown,
    learn_sensors as learn_sensors,
    observe_traces as observe_traces,
    sharp_bundles as sharp_bundles,
)
from ._exact import taken_for_exact as taken_for_exact
from ._found import (
    MEETS as MEETS,
    delay_found as delay_found,
    found_besides as found_besides,
    starts_sentence as starts_sentence,
    traces_met as traces_met,
)
from ._granted import by_gains as by_gains, uncertain_gains as uncertain_gains
from ._layout import SEGMENT as SEGMENT
from ._least_squares import (
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
    robust_deviation as robust_deviation,
    windowed_gram as windowed_gram,
)
from ._measured import Sensors as Sensors, white_sensors as white_sensors
from ._point import Point as Point, Reduced as Reduced, Secant as Secant, misfit_at as misfit_at
from ._profiles import Profile as Profile, Profiles as Profiles, profiling as profiling
from ._programs import (
    Question as Question,
    compiling_ahead as compiling_ahead,
    run_alone as run_alone,
    run_together as run_together,
)
from ._progress import CHI2_TOLERANCE as CHI2_TOLERANCE, Progress as Progress, Report as Report, quiet as quiet
from ._remains import VERDICTS as VERDICTS, Remains as Remains, find_remains as find_remains
from ._residuals import FitProblem as FitProblem, build_fit_problem as build_fit_problem
from ._search import LevenbergMarquardt as LevenbergMarquardt
from ._sensitivities import (
    jacobian as jacobian,
    observe as observe,
    observe_backwards as observe_backwards,
    observe_with_jacobian as observe_with_jacobian,
)
from ._sensors import Sensor as Sensor, noise_to_meet as noise_to_meet
from ._slices import WORDS as WORDS, End as End, Slice as Slice, Slices as Slices, slicing as slicing
from ._slopes import Slopes as Slopes
from ._starts import REACHED as REACHED
from ._task import RUNAWAY as RUNAWAY, Task as Task, plan_task as plan_task
from ._weighed import BLOCKS as BLOCKS, Linearised as Linearised, Weighed as Weighed
