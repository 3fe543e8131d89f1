"""What every friction model answers."""

import abc
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, PyTree

from ..._types import StateLeaf, Values
from ...parameters import Part
from .._vanes import Vanes


class Contact(eqx.Module):
    """What moves and presses where rod and guide touch."""

    velocity: Values
    """Velocity of the rod in m/s."""
    mass: Values
    """Mass that friction has to stop, in kg."""
    vanes: Vanes
    """Exhaust gas loads the bearings of the vanes."""


class AbstractFriction(Part):
    """Friction between rod and guide; the force opposes positive velocity.

    The state is a PyTree of scalars, `None` where a model has none.
    """

    place: ClassVar[str] = "friction"
    feels_gas: ClassVar[bool] = False
    """Whether turbine pressure changes it."""

    @abc.abstractmethod
    def initial_state(self) -> PyTree[StateLeaf]:
        """State at rest with nothing stretched."""

    @abc.abstractmethod
    def __call__(self, contact: Contact, state: Any, applied_force: Values) -> tuple[Values, PyTree[StateLeaf]]:
        """Friction force in N and the time derivative of the state.

        **Arguments:** `applied_force` in N: all other forces on the rod along +x.
        """

    @abc.abstractmethod
    def relaxation(self, contact: Contact, state: Any) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state, `-d(state')/d(state)`."""

    @abc.abstractmethod
    def damping(self, contact: Contact) -> Values:
        """The largest slope of the force over velocity in N s/m."""

    @abc.abstractmethod
    def steady_force(self, contact: Contact) -> Values:
        """Force in N of a rod that slides steadily at the contact's velocity."""

    @abc.abstractmethod
    def passivity_margin(self) -> Values | None:
        """Viscous damping in N s/m beyond the least with which friction never gives out energy, negative where it can.

        `None` for friction that can't whatever its parameters are.
        """

    @abc.abstractmethod
    def signals(self, state: Any) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""
