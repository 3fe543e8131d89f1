"""A controller on its plant: the closed loop, what it was worth, and how far it is from its limit of stability."""

from ._linear_loop import LinearLoop as LinearLoop, linearise_loop as linearise_loop
from ._loop import ClosedLoop as ClosedLoop, close_loop as close_loop
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
from ._observability import observability as observability
from ._replay import PROBES as PROBES, channels_used as channels_used, replay as replay
