"""What every friction model answers."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..._types import OwnState, StateLeaf, Values
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


class DryFriction(eqx.Module):
    """A law in the thesis's terms, as far as it has them: what bench tests read off traces."""

    coulomb_force: Values
    """`F_c` in N."""
    static_force: Values
    """`F_s` in N; `F_c` without stiction."""
    viscous_damping: Values
    """`sigma_2` in N s/m."""
    bristle_stiffness: Values | None = None
    """`sigma_0` in N/m; `None` where turns are not remembered."""
    bristle_damping: Values | None = None
    """`sigma_1` in N s/m; `None` for bristles without damping."""
    stribeck_velocity: Values | None = None
    """`v_s` in m/s; `None` where the sliding force does not fall with speed."""
    stribeck_exponent: int = eqx.field(static=True, default=1)

    @property
    def stiction(self) -> Values:
        """`F_s / F_c`; 1 without a Coulomb force, which has no share to give."""
        rubs = jnp.asarray(self.coulomb_force > 0)
        return jnp.where(rubs, self.static_force / jnp.where(rubs, self.coulomb_force, 1.0), 1.0)


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
    def __call__(self, contact: Contact, state: OwnState, applied_force: Values) -> tuple[Values, PyTree[StateLeaf]]:
        """Friction force in N and the time derivative of the state.

        **Arguments:** `applied_force` in N: all other forces on the rod along +x.
        """

    @abc.abstractmethod
    def relaxation(self, contact: Contact, state: OwnState) -> PyTree[StateLeaf]:
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

    @property
    def is_passive(self) -> bool:
        """Whether it never gives out energy; of many, whether none does."""
        margin = self.passivity_margin()
        return margin is None or bool(np.all(np.asarray(margin) >= 0))

    @abc.abstractmethod
    def dry(self) -> DryFriction | None:
        """Itself in the thesis's terms without exhaust gas [2.35, 3.1-3.7]; `None` for a law without a Coulomb force.

        Bench tests of dry friction are not possible on such a law; fits of its parameters are.
        """

    @abc.abstractmethod
    def signals(self, state: OwnState) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""
