"""No line: the converter sits on the chamber."""

import math
from collections.abc import Callable

from jaxtyping import Array

from .._air import Air
from .._converter import Flow
from ..chamber._base import Gas
from ._base import AbstractLine


class NoLine(AbstractLine):
    """The converter sees the chamber's pressure, and the chamber gets the converter's flow."""

    def initial_state(self, air: Air, gas: Gas) -> None:
        """Nothing to remember."""

    def port(self, air: Air, state: None, gas: Gas, flow: Callable[[Gas], Flow]) -> tuple[Gas, Flow]:
        """The chamber."""
        return gas, flow(gas)

    def __call__(self, air: Air, state: None, entering: Flow, gas: Gas) -> tuple[Flow, None]:
        """The converter's flow into the chamber."""
        return entering, None

    def relaxation(self, air: Air, state: None, gas: Gas) -> None:
        """No state, no rate."""

    @property
    def longest_step(self) -> float:
        """Any."""
        return math.inf

    def signals(self, state: None, inflow: Flow) -> dict[str, Array]:
        """Nothing to show: the flow is the converter's."""
        return {}

    def typical_state(self, gas: Gas) -> None:
        """No state, no size."""
