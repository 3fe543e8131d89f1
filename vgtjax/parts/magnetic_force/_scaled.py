"""The pull of a magnet that is stronger or weaker than it should be."""

from typing import ClassVar

from jaxtyping import Array, PyTree

from ..._types import OwnState, Scalar, StateLeaf, Values
from ...parameters import parameter
from ._base import AbstractMagneticForce


class ScaledForce(AbstractMagneticForce):
    """`factor` times the pull of another magnetic force: of a coil that is warm, or has another supply."""

    force: AbstractMagneticForce
    factor: Scalar = parameter(1.0, symbol="k", unit="1", source="assumed", held=True)
    rest_iterations: ClassVar[int] = 30

    def initial_state(self, pwm: Values) -> PyTree[StateLeaf]:
        """That of the other force."""
        return self.force.initial_state(pwm)

    def __call__(
        self, pwm: Values, position: Values, velocity: Values, state: OwnState
    ) -> tuple[Values, PyTree[StateLeaf]]:
        """See the base class."""
        pull, rates = self.force(pwm, position, velocity, state)
        return self.factor * pull, rates

    def steady_pull(self, pwm: Values, position: Values) -> Values:
        """See the base class."""
        return self.factor * self.force.steady_pull(pwm, position)

    def relaxation(self, position: Values, state: OwnState) -> PyTree[StateLeaf]:
        """That of the other force."""
        return self.force.relaxation(position, state)

    def signals(self, state: OwnState) -> dict[str, Array]:
        """Those of the other force."""
        return self.force.signals(state)

    def typical_state(self) -> PyTree[StateLeaf]:
        """That of the other force."""
        return self.force.typical_state()
