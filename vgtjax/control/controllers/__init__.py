"""Control laws, a file each."""

from ._adaptive_backstepping import (
    AdaptiveBackstepping as AdaptiveBackstepping,
    AdaptiveEstimate as AdaptiveEstimate,
)
from ._adrc import ADRC as ADRC
from ._backstepping import Backstepping as Backstepping
from ._balance import ConstantDuty as ConstantDuty, StaticBalance as StaticBalance, holding_duty as holding_duty
from ._fallback import WithFallback as WithFallback
from ._friction_compensation import FrictionCompensation as FrictionCompensation
from ._knocker import Knocker as Knocker
from ._load_backstepping import LoadBackstepping as LoadBackstepping
from ._lqg import LQG as LQG
from ._pid import PI as PI, PID as PID
from ._scheduled_pi import ScheduledPI as ScheduledPI
