"""What every model of the exhaust gas force on the vanes answers."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, PyTree

from ..air import Scalar
from ..diaphragm import Body


class AbstractVaneForce(eqx.Module):
    """Force of the exhaust gas on the rod, positive against +x; its state is a PyTree of scalars, `None` for none."""

    @abc.abstractmethod
    def initial_state(self) -> PyTree[Scalar]:
        """State at rest."""

    @abc.abstractmethod
    def __call__(
        self, body: Body, travel: Scalar, state: Any, turbine_pressure: Scalar
    ) -> tuple[Scalar, PyTree[Scalar]]:
        """Force in N, and the time derivative of the state.

        **Arguments:** the rod, its travel in m (the crank angle counts from the closed stop [3.14]), and the turbine
        inlet pressure in Pa gauge.
        """

    @abc.abstractmethod
    def relaxation(self, body: Body, state: Any) -> PyTree[Scalar]:
        """Rate in 1/s, one for each state, at which it forgets itself; `None` where it is slow."""

    @abc.abstractmethod
    def signals(self, state: Any) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[Scalar]:
        """The usual size of each state, by which an absolute tolerance is scaled."""
