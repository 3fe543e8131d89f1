"""What every model of the hose between converter and chamber answers."""

import abc
from collections.abc import Callable
from typing import ClassVar

from jaxtyping import Array, PyTree

from ..._types import OwnState, Scalar, StateLeaf
from ...parameters import Part, parameter
from .._air import Air
from .._converter import Flow
from ..chamber import GasState


class AbstractLine(Part):
    """A line that carries flow from the converter to the chamber; its state is a PyTree, `None` for no line."""

    place: ClassVar[str] = "line"

    @abc.abstractmethod
    def initial_state(self, air: Air, gas: GasState) -> PyTree[StateLeaf]:
        """State at rest, filled with the gas of the chamber."""

    @abc.abstractmethod
    def port(self, air: Air, state: OwnState, gas: GasState, flow: Callable[[GasState], Flow]) -> tuple[GasState, Flow]:
        """What the converter sees at its end of the line, and the flow that enters there.

        **Arguments:** `gas` is the state of the chamber; `flow` is the converter's, into a gas that it sees.
        """

    @abc.abstractmethod
    def __call__(self, air: Air, state: OwnState, entering: Flow, gas: GasState) -> tuple[Flow, PyTree[StateLeaf]]:
        """Flow into the chamber, and the time derivative of the state.

        **Arguments:** `entering` is the flow that `port` says; `gas` is the state of the chamber; `air` gives speed of
        sound and ambient temperature.
        """

    @abc.abstractmethod
    def relaxation(self, air: Air, state: OwnState, gas: GasState) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state, `None` where it is slow or oscillates."""

    @property
    @abc.abstractmethod
    def longest_step(self) -> float:
        """Longest step in s that resolves the line, infinite where any does."""

    @abc.abstractmethod
    def signals(self, state: OwnState, inflow: Flow) -> dict[str, Array]:
        """The state and the flow into the chamber, by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self, gas: GasState) -> PyTree[StateLeaf]:
        """The usual size of each state with `gas` in the line, by which an absolute tolerance is scaled."""


class AbstractHose(AbstractLine):
    """A line with a length and a bore, whose walls brake what flows."""

    length: Scalar = parameter(0.5, symbol="L", unit="m", source="assumed", lower=0.0)
    bore: Scalar = parameter(4e-3, symbol="D", unit="m", source="assumed")
    viscosity: Scalar = parameter(1.81e-5, symbol="mu", unit="Pa s", source="assumed", held=True)
