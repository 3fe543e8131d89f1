"""Pneumatic line between converter and chamber, on one interface."""

from ._base import AbstractLine as AbstractLine
from ._delay import DelayLine as DelayLine
from ._direct import NoLine as NoLine
from ._losses import (
    TURBULENT as TURBULENT,
    friction_rate as friction_rate,
    resistance as resistance,
    speed_of_sound as speed_of_sound,
)
from ._wave import WaveLine as WaveLine
