"""Control of the position [chapter 5]: references, sensors, controllers, and the closed loop."""

from ._adaptive_backstepping import (
    AdaptiveBackstepping as AdaptiveBackstepping,
    AdaptiveEstimate as AdaptiveEstimate,
    Moment as Moment,
)
from ._adrc import ADRC as ADRC
from ._backstepping import Backstepping as Backstepping
from ._balance import ConstantDuty as ConstantDuty, StaticBalance as StaticBalance, holding_duty as holding_duty
from ._base import (
    AbstractController as AbstractController,
    Measurement as Measurement,
    Reference as Reference,
    saturate as saturate,
)
from ._design import (
    AbstractDesign as AbstractDesign,
    Condition as Condition,
    check as check,
    designs_in as designs_in,
    positive as positive,
)
from ._design_model import DesignModel as DesignModel, DesignState as DesignState, Motion as Motion
from ._differentiator import (
    AbstractDifferentiator as AbstractDifferentiator,
    FilteredDifference as FilteredDifference,
    ImplicitLevantDifferentiator as ImplicitLevantDifferentiator,
    LevantDifferentiator as LevantDifferentiator,
)
from ._disturbances import (
    AbstractAlteration as AbstractAlteration,
    AbstractDisturbance as AbstractDisturbance,
    AbstractDutyPath as AbstractDutyPath,
    AbstractSensorFault as AbstractSensorFault,
    AbstractSurroundings as AbstractSurroundings,
)
from ._engine_disturbances import (
    CoilSupply as CoilSupply,
    LateDuty as LateDuty,
    TurbinePulsation as TurbinePulsation,
)
from ._fallback import WithFallback as WithFallback
from ._friction_compensation import FrictionCompensation as FrictionCompensation
from ._friction_observer import (
    DualFrictionObserver as DualFrictionObserver,
    FrictionEstimate as FrictionEstimate,
    nominal_coefficients as nominal_coefficients,
    slide as slide,
)
from ._knocker import Knocker as Knocker
from ._linear_loop import LinearLoop as LinearLoop, linearise_loop as linearise_loop
from ._load_backstepping import LoadBackstepping as LoadBackstepping
from ._load_observer import LoadEstimate as LoadEstimate, LoadObserver as LoadObserver
from ._loop import ClosedLoop as ClosedLoop, close_loop as close_loop, fade as fade
from ._lqg import LQG as LQG
from ._margins import Margins as Margins, margins as margins
from ._measures import (
    BAND as BAND,
    StepAnswer as StepAnswer,
    chatter as chatter,
    effort as effort,
    pressure_peak as pressure_peak,
    pressure_rms as pressure_rms,
    sliding_share as sliding_share,
    step_answers as step_answers,
    tracking_peak as tracking_peak,
    tracking_rms as tracking_rms,
)
from ._observability import estimates as estimates, observability as observability
from ._pid import PI as PI, PID as PID
from ._pressure_observer import ObservedState as ObservedState, PressureObserver as PressureObserver
from ._recurring import Draws as Draws, Periodic as Periodic
from ._reference import (
    SIGNAL_1_PERIOD as SIGNAL_1_PERIOD,
    AbstractSignal as AbstractSignal,
    Constant as Constant,
    FadeIn as FadeIn,
    Later as Later,
    Ramps as Ramps,
    Sampled as Sampled,
    Sine as Sine,
    Steps as Steps,
    number as number,
    reference_at as reference_at,
    signal_1 as signal_1,
    signal_2 as signal_2,
)
from ._replay import PROBES as PROBES, channels_used as channels_used, replay as replay
from ._scenario import Scenario as Scenario, at_rest as at_rest, balanced_at as balanced_at
from ._scheduled_pi import ScheduledPI as ScheduledPI
from ._sensor_faults import LostSensor as LostSensor, StuckSensor as StuckSensor
from ._sensors import Sensor as Sensor, Sensors as Sensors, quantise as quantise
