"""The mechanical half alone: measured pressure or force in, position out (section 3.6)."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .air import Air, Scalar
from .diaphragm import Body, Diaphragm
from .drive import Drive, Start
from .friction import AbstractFriction, LuGre
from .model import AbstractModel
from .vane_force import AbstractVaneForce, NoVaneForce


class MechanicalState(eqx.Module):
    """State of rod and friction, one scalar a leaf (SI units)."""

    body: Body
    friction: PyTree[Array]
    vanes: PyTree[Array]


class MechanicalActuator(AbstractModel):
    """Diaphragm, friction and vanes, moved by the measured chamber pressure or a measured force [2.34]."""

    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: AbstractFriction = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    air: Air = eqx.field(default_factory=Air)

    @property
    def needs(self) -> tuple[str, ...]:
        """A measured chamber pressure or drive force, and a position to compare with."""
        return ("p_act|f_drive", "x_d")

    def start(self, start: Start, drive: Drive) -> MechanicalState:
        """At rest in static balance, or at the mean position of the first 50 ms."""
        body = self.diaphragm.start(start, self._drive_force(0.0, drive))
        return MechanicalState(body, self.friction.initial_state(), self.vane_force.initial_state())

    def vector_field(self, time: Scalar, state: MechanicalState, drive: Drive) -> MechanicalState:
        """Time derivative of the state [2.34]."""
        body = state.body
        vane_force, vane_rate = self.vane_force(body, self.diaphragm.travel, state.vanes, drive.turbine(time))
        applied = self.diaphragm.applied_force(body, self._drive_force(time, drive) - vane_force)
        friction_force, friction_rate = self.friction(body.velocity, state.friction, applied)
        acceleration = (applied - friction_force) / self.diaphragm.mass
        return MechanicalState(Body(body.velocity, acceleration), friction_rate, vane_rate)

    def relaxation(self, state: MechanicalState) -> MechanicalState:
        """Rates of the rod and the bristles."""
        return MechanicalState(
            Body(None, self.diaphragm.damping_rate(self.friction.damping())),
            self.friction.relaxation(state.body.velocity),
            self.vane_force.relaxation(state.body, state.vanes),
        )

    def observe(self, state: MechanicalState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position, and the pressure that was put in (zero gauge where a force was)."""
        pressure = self.air.pressure if drive.chamber is None else drive.chamber(0.0)
        return state.body.position, jnp.broadcast_to(pressure, jnp.shape(state.body.position))

    def signals(self, state: MechanicalState, drive: Drive) -> dict[str, Array]:
        """States and the input."""
        source = {} if drive.chamber is None else {"p_act": drive.chamber(0.0)}
        if drive.force is not None:
            source = {"f_drive": drive.force(0.0)}
        return {
            "x_d": state.body.position,
            "v_d": state.body.velocity,
            **self.friction.signals(state.friction),
            **self.vane_force.signals(state.vanes),
            **source,
        }

    def typical_state(self) -> Any:
        """A centimetre, a tenth of a metre a second."""
        return MechanicalState(Body(1e-2, 0.1), self.friction.typical_state(), self.vane_force.typical_state())

    def _drive_force(self, time: Scalar | float, drive: Drive) -> Scalar:
        if drive.force is not None:
            return drive.force(time)
        assert drive.chamber is not None
        ambient = self.air.pressure + drive.ambient_shift
        return (ambient - drive.chamber(time)) * self.diaphragm.area
