"""What every model of the magnetic force answers."""

import abc
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, PyTree

from ..._types import OwnState, StateLeaf, Values
from ...parameters import Part


class AbstractMagneticForce(Part):
    """Pull of the solenoid on the plunger, positive downwards; its state is a PyTree of scalars, `None` for none."""

    place: ClassVar[str] = "converter.magnetic_force"

    rest_iterations: eqx.AbstractClassVar[int]
    """How often the balance of a plunger at rest is solved, which a pull that depends on its position needs more of:
    each brings it nearer by the ratio of magnetic to spring stiffness, which is below one."""

    @abc.abstractmethod
    def initial_state(self, pwm: Values) -> PyTree[StateLeaf]:
        """State after a duty in percent has been held for long."""

    @abc.abstractmethod
    def __call__(
        self, pwm: Values, position: Values, velocity: Values, state: OwnState
    ) -> tuple[Values, PyTree[StateLeaf]]:
        """Pull in N, and the time derivative of the state.

        **Arguments:** `pwm` in percent, `position` (m, up is positive) and `velocity` (m/s) of the plunger.
        """

    @abc.abstractmethod
    def steady_pull(self, pwm: Values, position: Values) -> Values:
        """Pull in N at a plunger position in m after a duty in percent has been held for long."""

    @abc.abstractmethod
    def relaxation(self, position: Values, state: OwnState) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state."""

    @abc.abstractmethod
    def signals(self, state: OwnState) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""
