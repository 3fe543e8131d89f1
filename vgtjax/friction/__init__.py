"""Friction models on one interface."""

from .base import AbstractFriction as AbstractFriction, Contact as Contact
from .lugre import Bristle as Bristle, LuGre as LuGre
