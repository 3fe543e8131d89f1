"""The pneumatic half alone: duty and the diaphragm's position in, chamber pressure out [2.58, without 2.34]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .._types import Values
from ..parameters import nested
from ..parts import AbstractChamber, AbstractLine, Air, Converter, Diaphragm
from ..traces import Drive, Start
from ._air_path import AbstractAirPathModel, AirPath, AirPathState, ambient_pressure
from ._base import assemble


class PneumaticActuator(AbstractAirPathModel):
    """Converter, line and chamber, whose volume follows a given position of the diaphragm.

    The counterpart of the mechanical half: friction, springs and vanes have no say, so that the measured
    pressure is information about the pneumatics only. Of the diaphragm only the area counts.
    """

    air_path: AirPath = nested()
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    air: Air = eqx.field(default_factory=Air)

    def __init__(
        self,
        converter: Converter | None = None,
        line: AbstractLine | None = None,
        chamber: AbstractChamber | None = None,
        diaphragm: Diaphragm | None = None,
        air: Air | None = None,
        *,
        air_path: AirPath | None = None,
    ):
        self.air_path = assemble(air_path or AirPath(), converter=converter, line=line, chamber=chamber)
        self.diaphragm = diaphragm or Diaphragm()
        self.air = air or Air()

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty and a position to follow."""
        return ("pwm", "x_drive")

    def start(self, start: Start, drive: Drive) -> AirPathState:
        """State at rest: ambient pressure, or the mean of the first 50 ms, or the working pressure of the duty."""
        working = self.air_path.working_pressure(self.air, drive)
        pressure = jnp.where(start.pressure_known, start.pressure, working)
        pressure = jnp.where(start.at_rest, ambient_pressure(self.air, drive), pressure)
        return self.air_path.start(self.air, pressure, drive)

    def vector_field(self, time: Values, state: AirPathState, drive: Drive) -> AirPathState:
        """Time derivative of the state [2.58]."""
        assert drive.position is not None
        displaced = self.diaphragm.displaced_volume(drive.position(time))
        displacement_rate = self.diaphragm.displaced_volume(drive.position.rate)
        return self.air_path.rates(self.air, time, state, drive, displaced, displacement_rate)

    def relaxation(self, time: Values, state: AirPathState, drive: Drive) -> AirPathState:
        """Rates of the plunger, and of what else has fast states."""
        assert drive.position is not None
        return self.air_path.relaxation(self.air, state, self.diaphragm.displaced_volume(drive.position(time)))

    @property
    def longest_step(self) -> float:
        """That of the air path."""
        return self.air_path.longest_step

    def observe(self, state: AirPathState, drive: Drive) -> tuple[Values, Values]:
        """The position that was put in, and the chamber pressure."""
        assert drive.position is not None
        return jnp.broadcast_to(drive.position(0.0), jnp.shape(state.gas.pressure)), state.gas.pressure

    def signals(self, state: AirPathState, drive: Drive) -> dict[str, Array]:
        """All of the air path, and the input."""
        return {**self.air_path.signals(self.air, state, drive), "x_d": self.observe(state, drive)[0]}

    def typical_state(self) -> AirPathState:
        """That of the air path."""
        return self.air_path.typical_state(self.air)
