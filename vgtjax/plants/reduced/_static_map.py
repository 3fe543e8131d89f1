"""The model for control with four states: flow as a map of duty and pressure [5.4]."""

import math
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array

from ...parts import (
    AbstractFlowMap,
    AbstractFriction,
    AbstractVaneForce,
    Air,
    Diaphragm,
    IsothermalChamber,
    LuGre,
    NoVaneForce,
    Scalar,
)
from ...traces import Drive, Start
from .._actuator import Actuator
from .._base import AbstractModel
from .._rod import Rod
from ._capsule import Capsule, CapsuleState
from ._fitting import fit_flow_map


def _printed_actuators() -> Any:
    with jax.ensure_compile_time_eval():  # also where a model is made under jit
        return fit_flow_map(Actuator()).flow_map


class StaticMapActuator(AbstractModel):
    """Flow map, isothermal chamber, diaphragm, friction and vanes [5.4]; the plunger follows at once.

    Position, velocity, bristles and pressure are four states with LuGre friction; other friction and vane forces bring
    their own. The reservoir's pressure is that of the map, whatever a trace says. [`reduce_to_static_map`][] makes one
    from a full actuator; without arguments it is that of the printed one.
    """

    flow_map: AbstractFlowMap = eqx.field(default_factory=_printed_actuators)
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: AbstractFriction = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    air: Air = eqx.field(default_factory=Air)

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty."""
        return ("pwm",)

    def start(self, start: Start, drive: Drive) -> CapsuleState:
        """State at rest, as the full model has it, with the working pressure of the map."""
        capsule = self._capsule
        return capsule.start(start, drive, self.flow_map.working_pressure(drive.pwm, capsule.ambient(drive)))

    def vector_field(self, time: Scalar, state: CapsuleState, drive: Drive) -> CapsuleState:
        """Time derivative of the state [5.4]."""
        return self._capsule.rates(time, state, self._flow(state, drive), drive)

    def relaxation(self, time: Scalar, state: CapsuleState, drive: Drive) -> CapsuleState:
        """Rates of the rod and its friction and vanes."""
        return self._capsule.relaxation(time, state, drive)

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def observe(self, state: CapsuleState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position and chamber pressure."""
        return state.rod.body.position, state.pressure

    def signals(self, state: CapsuleState, drive: Drive) -> dict[str, Array]:
        """States and flow."""
        return self._capsule.signals(state, self._flow(state, drive), drive)

    def typical_state(self) -> Any:
        """That of the capsule."""
        return self._capsule.typical_state()

    @property
    def _capsule(self) -> Capsule:
        return Capsule(self.chamber, Rod(self.diaphragm, self.friction, self.vane_force), self.air)

    def _flow(self, state: CapsuleState, drive: Drive) -> Scalar:
        return self.flow_map(drive.pwm, state.pressure, self._capsule.ambient(drive))
