"""Pneumatic line between converter and chamber, on one interface."""

from .base import AbstractLine as AbstractLine
from .delay import DelayLine as DelayLine
from .direct import NoLine as NoLine
from .wave import WaveLine as WaveLine
