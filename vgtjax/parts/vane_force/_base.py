"""What every model of the exhaust gas force on the vanes answers."""

import abc
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..._types import OwnState, StateLeaf, Values
from ...parameters import Part
from .._stateless import Stateless
from .._vanes import Vanes


class AbstractVaneForce(Part):
    """Force of the exhaust gas on the rod, positive against +x; its state is a PyTree of scalars, `None` for none."""

    place: ClassVar[str] = "vane_force"
    feels_gas: ClassVar[bool] = True
    """Whether turbine pressure changes it."""
    equations: ClassVar[str] = ""
    """Where it comes from, by the numbers of equations."""
    caveat: ClassVar[str] = ""
    """What is to be said wherever its force is shown."""

    @property
    def acts(self) -> bool:
        """Whether its force is other than zero anywhere."""
        return self.feels_gas

    @abc.abstractmethod
    def initial_state(self) -> PyTree[StateLeaf]:
        """State at rest."""

    @abc.abstractmethod
    def __call__(self, vanes: Vanes, velocity: Values, state: OwnState) -> tuple[Values, PyTree[StateLeaf]]:
        """Force in N, and the time derivative of the state.

        **Arguments:** where the vanes are and the turbine pressure; `velocity` of the rod in m/s.
        """

    @abc.abstractmethod
    def steady_force(self, vanes: Vanes, velocity: Values) -> Values:
        """Force in N of vanes that move steadily at a velocity of the rod in m/s."""

    @abc.abstractmethod
    def relaxation(self, vanes: Vanes, velocity: Values, state: OwnState) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state; `None` where it is slow."""

    def damping(self, vanes: Vanes, velocity: Values) -> Values:
        """How strongly the force damps the rod, in N s/m; zero of one that does not follow the velocity at once."""
        return jnp.zeros_like(velocity)

    @abc.abstractmethod
    def signals(self, vanes: Vanes, velocity: Values, state: OwnState) -> dict[str, Array]:
        """The force as `f_vane` in N, where there is one."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""


class AbstractStatelessVaneForce(Stateless, AbstractVaneForce):
    """A force that remembers nothing: it follows gas and motion at once."""

    def steady_force(self, vanes: Vanes, velocity: Values) -> Values:
        """The force at once."""
        return self(vanes, velocity, None)[0]

    def signals(self, vanes: Vanes, velocity: Values, state: None) -> dict[str, Array]:
        """`f_vane` in N."""
        return {"f_vane": self(vanes, velocity, state)[0]}
