"""Control of the position [chapter 5]: references, sensors, controllers, and the closed loop."""

from .adaptive_backstepping import AdaptiveBackstepping as AdaptiveBackstepping
from .backstepping import Backstepping as Backstepping
from .balance import ConstantDuty as ConstantDuty, StaticBalance as StaticBalance, holding_duty as holding_duty
from .base import (
    AbstractController as AbstractController,
    Measurement as Measurement,
    Reference as Reference,
    saturate as saturate,
)
from .cost import (
    chatter as chatter,
    effort as effort,
    tracking_peak as tracking_peak,
    tracking_rms as tracking_rms,
)
from .design_model import DesignModel as DesignModel, DesignState as DesignState
from .differentiator import (
    AbstractDifferentiator as AbstractDifferentiator,
    FilteredDifference as FilteredDifference,
    LevantDifferentiator as LevantDifferentiator,
)
from .friction_compensation import FrictionCompensation as FrictionCompensation
from .friction_observer import DualFrictionObserver as DualFrictionObserver
from .knocker import Knocker as Knocker
from .loop import ClosedLoop as ClosedLoop, close_loop as close_loop
from .pid import PI as PI, PID as PID
from .pressure_observer import ObservedState as ObservedState, PressureObserver as PressureObserver
from .reference import (
    AbstractSignal as AbstractSignal,
    Constant as Constant,
    FadeIn as FadeIn,
    Later as Later,
    Ramps as Ramps,
    Sampled as Sampled,
    Sine as Sine,
    Steps as Steps,
    reference_at as reference_at,
    signal_1 as signal_1,
    signal_2 as signal_2,
)
from .scenario import Scenario as Scenario, at_rest as at_rest, balanced_at as balanced_at
from .sensors import Sensor as Sensor, Sensors as Sensors, quantise as quantise
