"""Pneumatic line between converter and chamber, on one interface."""

from .base import AbstractLine as AbstractLine
from .direct import NoLine as NoLine
