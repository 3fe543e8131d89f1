"""The mechanical half alone: measured pressure or force in, position out (section 3.6)."""

import math

import jax.numpy as jnp
from jaxtyping import Array

from .._types import Values
from ..parameters import nested
from ..parts import AbstractFriction, AbstractVaneForce, Air, Diaphragm
from ..traces import Drive, Start
from ._air_path import ambient_pressure
from ._base import assemble
from ._rod import AbstractRodModel, Rod, RodState


class MechanicalActuator(AbstractRodModel):
    """Diaphragm, friction and vanes, moved by the measured chamber pressure or a measured force [2.34]."""

    rod: Rod = nested()
    air: Air

    def __init__(
        self,
        diaphragm: Diaphragm | None = None,
        friction: AbstractFriction | None = None,
        vane_force: AbstractVaneForce | None = None,
        air: Air | None = None,
        *,
        rod: Rod | None = None,
    ):
        self.rod = assemble(rod or Rod(), diaphragm=diaphragm, friction=friction, vane_force=vane_force)
        self.air = air or Air()

    @property
    def needs(self) -> tuple[str, ...]:
        """A measured chamber pressure or drive force, and a position to compare with."""
        return ("p_act|f_drive", "x_d")

    @property
    def sensed(self) -> tuple[str, ...]:
        """The position: a chamber pressure drives it."""
        return ("x_d",)

    def start(self, start: Start, drive: Drive) -> RodState:
        """At rest in static balance, or at the mean position of the first 50 ms."""
        return self.rod.start(start, self._drive_force(0.0, drive))

    def vector_field(self, time: Values, state: RodState, drive: Drive) -> RodState:
        """Time derivative of the state [2.34]."""
        return self.rod.rates(state, self._drive_force(time, drive), drive.turbine(time), drive.ambient_shift)

    def relaxation(self, time: Values, state: RodState, drive: Drive) -> RodState:
        """Rates of the rod, friction and vanes."""
        return self.rod.relaxation(state, drive.turbine(time), ambient_shift=drive.ambient_shift)

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def observe(self, state: RodState, drive: Drive) -> tuple[Values, Values]:
        """Position, and the pressure that was put in (zero gauge where a force was)."""
        pressure = self.air.pressure if drive.chamber is None else drive.chamber(0.0)
        return state.body.position, jnp.broadcast_to(pressure, jnp.shape(state.body.position))

    def signals(self, state: RodState, drive: Drive) -> dict[str, Array]:
        """States and the input."""
        source = {} if drive.chamber is None else {"p_act": drive.chamber(0.0)}
        if drive.force is not None:
            source = {"f_drive": drive.force(0.0)}
        return {**self.rod.signals(state, drive.turbine(0.0), drive.ambient_shift), **source}

    def typical_state(self) -> RodState:
        """That of the rod."""
        return self.rod.typical_state()

    def _drive_force(self, time: Values, drive: Drive) -> Values:
        if drive.force is not None:
            return drive.force(time)
        assert drive.chamber is not None
        return self.rod.diaphragm.drive_force(ambient_pressure(self.air, drive), drive.chamber(time))
