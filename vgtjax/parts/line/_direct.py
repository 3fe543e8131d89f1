"""No line: the converter sits on the chamber."""

import math
from collections.abc import Callable

from .._air import Air
from .._converter import Flow
from .._stateless import Stateless
from ..chamber import GasState
from ._base import AbstractLine


class NoLine(Stateless, AbstractLine):
    """The converter sees the chamber's pressure, and the chamber gets the converter's flow."""

    def port(self, air: Air, state: None, gas: GasState, flow: Callable[[GasState], Flow]) -> tuple[GasState, Flow]:
        """The chamber."""
        return gas, flow(gas)

    def __call__(self, air: Air, state: None, entering: Flow, gas: GasState) -> tuple[Flow, None]:
        """The converter's flow into the chamber."""
        return entering, None

    @property
    def longest_step(self) -> float:
        """Any."""
        return math.inf
