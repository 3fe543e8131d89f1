"""Exhaust gas."""

from typing import ClassVar

import equinox as eqx

from .._types import Scalar
from ..parameters import parameter
from ..parts import AbstractIdealGas
from ..turbine import GAS_CONSTANT, GAS_GAMMA


class ExhaustGas(AbstractIdealGas):
    """Burnt gas of a Diesel engine, with heat capacities at some 900 K."""

    place: ClassVar[str] = "gas"

    gas_constant: Scalar = parameter(GAS_CONSTANT, symbol="R", unit="J/(kg K)", source="assumed", held=True)
    heat_capacity_ratio: Scalar = parameter(GAS_GAMMA, symbol="gamma", unit="1", source="assumed", held=True, above=1.0)
    linear_above: float = eqx.field(static=True, default=0.9999)
    """Pressure ratio above which the flow function is a straight line to zero; a numerical setting. The nearer to one,
    the faster a cylinder and the manifold become equal, and the shorter the steps must be."""
