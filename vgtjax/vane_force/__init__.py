"""Exhaust gas force on the vanes, on one interface."""

from .absent import NoVaneForce as NoVaneForce
from .base import AbstractVaneForce as AbstractVaneForce
from .map import Direction as Direction, HysteresisMap as HysteresisMap
from .polynomial import ForcePolynomial as ForcePolynomial
