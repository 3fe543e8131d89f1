"""The mechanical half alone: measured pressure or force in, position out (section 3.6)."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..parts import AbstractFriction, AbstractVaneForce, Air, Diaphragm, LuGre, NoVaneForce, Scalar
from ..traces import Drive, Start
from ._base import AbstractModel
from ._rod import Rod, RodState


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

    def start(self, start: Start, drive: Drive) -> RodState:
        """At rest in static balance, or at the mean position of the first 50 ms."""
        return self._rod.start(start, self._drive_force(0.0, drive))

    def vector_field(self, time: Scalar, state: RodState, drive: Drive) -> RodState:
        """Time derivative of the state [2.34]."""
        return self._rod.rates(state, self._drive_force(time, drive), drive.turbine(time))

    def relaxation(self, time: Scalar, state: RodState, drive: Drive) -> RodState:
        """Rates of the rod, friction and vanes."""
        return self._rod.relaxation(state, drive.turbine(time))

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def observe(self, state: RodState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position, and the pressure that was put in (zero gauge where a force was)."""
        pressure = self.air.pressure if drive.chamber is None else drive.chamber(0.0)
        return state.body.position, jnp.broadcast_to(pressure, jnp.shape(state.body.position))

    def signals(self, state: RodState, drive: Drive) -> dict[str, Array]:
        """States and the input."""
        source = {} if drive.chamber is None else {"p_act": drive.chamber(0.0)}
        if drive.force is not None:
            source = {"f_drive": drive.force(0.0)}
        return {**self._rod.signals(state, drive.turbine(0.0)), **source}

    def typical_state(self) -> Any:
        """That of the rod."""
        return self._rod.typical_state()

    @property
    def _rod(self) -> Rod:
        return Rod(self.diaphragm, self.friction, self.vane_force)

    def _drive_force(self, time: Scalar | float, drive: Drive) -> Scalar:
        if drive.force is not None:
            return drive.force(time)
        assert drive.chamber is not None
        ambient = self.air.pressure + drive.ambient_shift
        return (ambient - drive.chamber(time)) * self.diaphragm.area
