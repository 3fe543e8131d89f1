"""What every model of the hose between converter and chamber answers."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, PyTree

from ..air import Air, Scalar
from ..chamber import Gas
from ..converter import Flow


class AbstractLine(eqx.Module):
    """A line that carries flow from the converter to the chamber; its state is a PyTree, `None` for no line."""

    @abc.abstractmethod
    def initial_state(self, air: Air, gas: Gas) -> PyTree[Scalar]:
        """State at rest, filled with the gas of the chamber."""

    @abc.abstractmethod
    def upstream(self, state: Any, gas: Gas) -> Gas:
        """What the converter sees at its port; `gas` is the state of the chamber."""

    @abc.abstractmethod
    def __call__(self, air: Air, state: Any, entering: Flow, gas: Gas) -> tuple[Flow, PyTree[Scalar]]:
        """Flow into the chamber, and the time derivative of the state.

        **Arguments:** `entering` is the flow out of the converter into what `upstream` says; `gas` is the state of
        the chamber; `air` gives speed of sound and ambient temperature.
        """

    @abc.abstractmethod
    def relaxation(self, air: Air, state: Any, gas: Gas) -> PyTree[Scalar]:
        """Rate in 1/s, one for each state, at which it forgets itself, `None` where it is slow or oscillates."""

    @property
    @abc.abstractmethod
    def longest_step(self) -> float:
        """Longest step in s that resolves the line, infinite where any does."""

    @abc.abstractmethod
    def signals(self, state: Any) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self, gas: Gas) -> PyTree[Scalar]:
        """The usual size of each state with `gas` in the line, by which an absolute tolerance is scaled."""
