"""Friction models on one interface."""

from .adaptive import AdaptiveLuGre as AdaptiveLuGre
from .base import AbstractFriction as AbstractFriction, Contact as Contact
from .coulomb import Coulomb as Coulomb
from .dahl import Dahl as Dahl
from .karnopp import Karnopp as Karnopp
from .lugre import Bristle as Bristle, LuGre as LuGre, PassivityWarning as PassivityWarning
from .passive import PassiveLuGre as PassiveLuGre
