"""What was measured, what is known of its sensors and of the duty, and the weighted residuals of a model against it."""

from ._duties import (
    RECORDED as RECORDED,
    FoundDuty as FoundDuty,
    Late as Late,
    Reading as Reading,
    as_recorded as as_recorded,
    in_seconds as in_seconds,
    read_duties as read_duties,
)
from ._edge_times import Edges as Edges, known_beforehand as known_beforehand
from ._evidence import (
    DELAY_SCALE as DELAY_SCALE,
    EVIDENT as EVIDENT,
    LONGEST_DELAY as LONGEST_DELAY,
    MOST_CORRECTIONS as MOST_CORRECTIONS,
    NEARBY as NEARBY,
    NOTHING as NOTHING,
    SETTLED as SETTLED,
    SHORTEST as SHORTEST,
    SMALL_GAIN as SMALL_GAIN,
    Unknown as Unknown,
    by_trace as by_trace,
    learn_sensors as learn_sensors,
    observe_traces as observe_traces,
    sharp_bundles as sharp_bundles,
    simulated as simulated,
    turns as turns,
)
from ._holds import (
    PERCEPTIBLE as PERCEPTIBLE,
    Holds as Holds,
    ramped as ramped,
    read_holds as read_holds,
    sample_interval as sample_interval,
)
from ._inputs import InputSensor as InputSensor, read_inputs as read_inputs
from ._instruments import inputs_of as inputs_of, instrumented as instrumented
from ._measured import SensorsOfTraces as SensorsOfTraces, count_of as count_of, white_sensors as white_sensors
from ._residuals import FitProblem as FitProblem, Prior as Prior, build_fit_problem as build_fit_problem
from ._sensors import (
    Samples as Samples,
    SensorNoise as SensorNoise,
    innovations as innovations,
    left_over_noise as left_over_noise,
    noise_to_meet as noise_to_meet,
)
