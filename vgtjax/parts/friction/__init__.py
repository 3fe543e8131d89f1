"""Friction models on one interface."""

from ._adaptive import AdaptiveLuGre as AdaptiveLuGre
from ._base import AbstractFriction as AbstractFriction, Contact as Contact, DryFriction as DryFriction
from ._bristles import AbstractLuGre as AbstractLuGre, Bristle as Bristle
from ._coulomb import Coulomb as Coulomb
from ._dahl import Dahl as Dahl
from ._karnopp import Karnopp as Karnopp
from ._lugre import LuGre as LuGre, PassivityWarning as PassivityWarning
from ._passive import PassiveLuGre as PassiveLuGre
