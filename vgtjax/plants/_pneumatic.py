"""The pneumatic half alone: duty and the diaphragm's position in, chamber pressure out [2.58, without 2.34]."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..parts import (
    AbstractChamber,
    AbstractLine,
    AdiabaticChamber,
    Air,
    Converter,
    Diaphragm,
    Flow,
    Gas,
    NoLine,
    Plunger,
    Scalar,
)
from ..traces import Drive, Start
from ._base import AbstractModel


class PneumaticState(eqx.Module):
    """State of the pneumatic half, one scalar a leaf (SI units)."""

    plunger: Plunger
    magnet: PyTree[Array]
    line: PyTree[Array]
    gas: Gas


class PneumaticActuator(AbstractModel):
    """Converter, line and chamber, whose volume follows a given position of the diaphragm.

    The counterpart of the mechanical half: friction, springs and vanes have no say, so that what the measured
    pressure tells is about the pneumatics only. Of the diaphragm only the area counts.
    """

    converter: Converter = eqx.field(default_factory=Converter)
    line: AbstractLine = eqx.field(default_factory=NoLine)
    chamber: AbstractChamber = eqx.field(default_factory=AdiabaticChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    air: Air = eqx.field(default_factory=Air)

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty and a position to follow."""
        return ("pwm", "x_drive")

    def start(self, start: Start, drive: Drive) -> PneumaticState:
        """State at rest: ambient pressure, or the mean of the first 50 ms, or the working pressure of the duty."""
        ambient, reservoir = self._ambient(drive), self._reservoir(0.0, drive)
        pressure = jnp.where(
            start.pressure_known, start.pressure, self.converter.working_pressure(drive.pwm, ambient, reservoir)
        )
        pressure = jnp.where(start.at_rest, ambient, pressure)
        gas = Gas(pressure, jnp.broadcast_to(self.air.temperature, jnp.shape(pressure)))
        lift = self.converter.rest_position(drive.pwm, ambient, reservoir, pressure)
        return PneumaticState(
            Plunger(lift, jnp.zeros_like(lift)),
            self.converter.magnet.initial_state(drive.pwm),
            self.line.initial_state(self.air, gas),
            gas,
        )

    def vector_field(self, time: Scalar, state: PneumaticState, drive: Drive) -> PneumaticState:
        """Time derivative of the state [2.58]."""
        assert drive.position is not None
        ambient, reservoir = self._ambient(drive), self._reservoir(time, drive)
        plunger, gas = state.plunger, state.gas
        upstream, entering = self._port(state, ambient, reservoir)
        inflow, line_rate = self.line(self.air, state.line, entering, gas)
        pull, magnet_rate = self.converter.magnet(drive.pwm, plunger.position, plunger.velocity, state.magnet)
        lift_rate = self.converter.acceleration(plunger, pull, ambient, reservoir, upstream.pressure)
        displaced = self.diaphragm.displaced_volume(drive.position(time))
        displacement_rate = self.diaphragm.displaced_volume(drive.position.rate)
        return PneumaticState(
            Plunger(plunger.velocity, lift_rate),
            magnet_rate,
            line_rate,
            self.chamber.rates(self.air, gas, inflow, displaced, displacement_rate),
        )

    def relaxation(self, time: Scalar, state: PneumaticState, drive: Drive) -> PneumaticState:
        """Rates of the plunger, and of what else has fast states."""
        assert drive.position is not None
        displaced = self.diaphragm.displaced_volume(drive.position(time))
        return PneumaticState(
            Plunger(None, self.converter.damping_rate()),
            self.converter.magnet.relaxation(state.plunger.position, state.magnet),
            self.line.relaxation(self.air, state.line, state.gas),
            self.chamber.relaxation(self.air, state.gas, displaced),
        )

    @property
    def longest_step(self) -> float:
        """What the line resolves; everything else is resolved by the default."""
        return self.line.longest_step

    def observe(self, state: PneumaticState, drive: Drive) -> tuple[Scalar, Scalar]:
        """The position that was put in, and the chamber pressure."""
        assert drive.position is not None
        return jnp.broadcast_to(drive.position(0.0), jnp.shape(state.gas.pressure)), state.gas.pressure

    def signals(self, state: PneumaticState, drive: Drive) -> dict[str, Array]:
        """States, and the input."""
        _, entering = self._port(state, self._ambient(drive), self._reservoir(0.0, drive))
        inflow, _ = self.line(self.air, state.line, entering, state.gas)
        return {
            "x_p": state.plunger.position,
            "v_p": state.plunger.velocity,
            **self.converter.magnet.signals(state.magnet),
            **self.line.signals(state.line, inflow),
            "x_d": self.observe(state, drive)[0],
            "T_act": state.gas.temperature,
            "p_act": state.gas.pressure,
        }

    def typical_state(self) -> Any:
        """Millimetres, tenths of metres a second, ambient pressure and temperature."""
        gas = Gas(self.air.pressure, self.air.temperature)
        return PneumaticState(
            Plunger(1e-3, 0.1), self.converter.magnet.typical_state(), self.line.typical_state(gas), gas
        )

    def _port(self, state: PneumaticState, ambient: Scalar, reservoir: Scalar) -> tuple[Gas, Flow]:
        """What the converter sees, and the flow that leaves it."""

        def flow(into: Gas) -> Flow:
            lift = state.plunger.position
            return self.converter.flow(self.air, lift, ambient, reservoir, into.pressure, into.temperature)

        return self.line.port(self.air, state.line, state.gas, flow)

    def _ambient(self, drive: Drive) -> Scalar:
        return self.air.pressure + drive.ambient_shift

    def _reservoir(self, time: Scalar | float, drive: Drive) -> Scalar:
        assert drive.reservoir is not None, "a trace without one gets the assumed pressure"
        return drive.reservoir(time)
