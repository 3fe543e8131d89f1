"""What every model of the magnetic force answers."""

import abc
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, PyTree

from ...parameters import Part
from .._air import Scalar


class AbstractMagneticForce(Part):
    """Pull of the solenoid on the plunger, positive downwards; its state is a PyTree of scalars, `None` for none."""

    place: ClassVar[str] = "converter.magnetic_force"

    rest_iterations: eqx.AbstractClassVar[int]
    """How often the balance of a plunger at rest is solved, which a pull that depends on its position needs more of:
    each brings it nearer by the ratio of magnetic to spring stiffness, which is below one."""

    @abc.abstractmethod
    def initial_state(self, pwm: Scalar) -> PyTree[Scalar]:
        """State after a duty in percent has been held for long."""

    @abc.abstractmethod
    def __call__(self, pwm: Scalar, position: Scalar, velocity: Scalar, state: Any) -> tuple[Scalar, PyTree[Scalar]]:
        """Pull in N, and the time derivative of the state.

        **Arguments:** `pwm` in percent, `position` (m, up is positive) and `velocity` (m/s) of the plunger.
        """

    @abc.abstractmethod
    def steady_pull(self, pwm: Scalar, position: Scalar) -> Scalar:
        """Pull in N at a plunger position in m after a duty in percent has been held for long."""

    @abc.abstractmethod
    def relaxation(self, position: Scalar, state: Any) -> PyTree[Scalar]:
        """Rate in 1/s, one for each state, at which it forgets itself."""

    @abc.abstractmethod
    def signals(self, state: Any) -> dict[str, Array]:
        """The state by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[Scalar]:
        """The usual size of each state, by which an absolute tolerance is scaled."""
