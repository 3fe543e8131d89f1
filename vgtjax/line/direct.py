"""No line: the converter sits on the chamber."""

from collections.abc import Callable

from jaxtyping import Array

from ..air import Air, Scalar
from ..chamber import Gas
from ..converter import Flow
from .base import AbstractLine


class NoLine(AbstractLine):
    """The converter sees the chamber's pressure, and the chamber gets the converter's flow."""

    def initial_state(self, gas: Gas) -> None:
        """Nothing to remember."""
        return

    def __call__(self, air: Air, state: None, source: Callable[[Scalar, Scalar], Flow], gas: Gas) -> tuple[Flow, None]:
        """The converter's flow into the chamber."""
        return source(gas.pressure, gas.temperature), None

    def relaxation(self, state: None) -> None:
        """No state, no rate."""
        return

    def signals(self, state: None) -> dict[str, Array]:
        """Nothing to show."""
        return {}

    def typical_state(self, gas: Gas) -> None:
        """No state, no size."""
