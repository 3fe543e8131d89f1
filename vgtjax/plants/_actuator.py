"""The full actuator: duty in, chamber pressure and position out [2.58]."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..parts import (
    AbstractChamber,
    AbstractFriction,
    AbstractLine,
    AbstractVaneForce,
    AdiabaticChamber,
    Air,
    Converter,
    Diaphragm,
    Flow,
    Gas,
    LuGre,
    NoLine,
    NoVaneForce,
    Plunger,
    Scalar,
)
from ..traces import Drive, Start
from ._base import AbstractModel
from ._rod import Rod, RodState


class ActuatorState(eqx.Module):
    """State of the full actuator, one scalar a leaf (SI units)."""

    plunger: Plunger
    magnet: PyTree[Array]
    line: PyTree[Array]
    gas: Gas
    rod: RodState


class Actuator(AbstractModel):
    """Converter, line, chamber, diaphragm, friction and vanes, put together [2.58, corrected].

    Without arguments it has the parameters printed in the thesis's Tables B.1 to B.3.
    """

    converter: Converter = eqx.field(default_factory=Converter)
    line: AbstractLine = eqx.field(default_factory=NoLine)
    chamber: AbstractChamber = eqx.field(default_factory=AdiabaticChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: AbstractFriction = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    air: Air = eqx.field(default_factory=Air)

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty."""
        return ("pwm",)

    def start(self, start: Start, drive: Drive) -> ActuatorState:
        """State at rest: ambient pressure and static balance, or the means of the first 50 ms.

        Pressures and positions that a trace does not tell are those of static balance.
        """
        ambient, reservoir = self._ambient(drive), self._reservoir(0.0, drive)
        balanced = ambient - self.diaphragm.balance_force(start.position) / self.diaphragm.area
        working = self.converter.working_pressure(drive.pwm, ambient, reservoir)
        pressure = start.chamber_pressure(ambient, balanced, working)
        rod = self._rod.start(start, self._drive_force(ambient, pressure))
        gas = Gas(pressure, jnp.broadcast_to(self.air.temperature, jnp.shape(pressure)))
        lift = self.converter.rest_position(drive.pwm, ambient, reservoir, pressure)
        return ActuatorState(
            Plunger(lift, jnp.zeros_like(lift)),
            self.converter.magnet.initial_state(drive.pwm),
            self.line.initial_state(self.air, gas),
            gas,
            rod,
        )

    def vector_field(self, time: Scalar, state: ActuatorState, drive: Drive) -> ActuatorState:
        """Time derivative of the state [2.58]."""
        ambient, reservoir = self._ambient(drive), self._reservoir(time, drive)
        plunger, gas, body = state.plunger, state.gas, state.rod.body
        upstream, entering = self._port(state, ambient, reservoir)
        inflow, line_rate = self.line(self.air, state.line, entering, gas)
        pull, magnet_rate = self.converter.magnet(drive.pwm, plunger.position, plunger.velocity, state.magnet)
        return ActuatorState(
            Plunger(
                plunger.velocity,
                self.converter.acceleration(plunger, pull, ambient, reservoir, upstream.pressure),
            ),
            magnet_rate,
            line_rate,
            self.chamber.rates(
                self.air,
                gas,
                inflow,
                self.diaphragm.displaced_volume(body.position),
                self.diaphragm.displaced_volume(body.velocity),
            ),
            self._rod.rates(state.rod, self._drive_force(ambient, gas.pressure), drive.turbine(time)),
        )

    def relaxation(self, time: Scalar, state: ActuatorState, drive: Drive) -> ActuatorState:
        """Rates of the plunger, the rod and what else has fast states."""
        displaced = self.diaphragm.displaced_volume(state.rod.body.position)
        return ActuatorState(
            Plunger(None, self.converter.damping_rate()),
            self.converter.magnet.relaxation(state.plunger.position, state.magnet),
            self.line.relaxation(self.air, state.line, state.gas),
            self.chamber.relaxation(self.air, state.gas, displaced),
            self._rod.relaxation(state.rod, drive.turbine(time)),
        )

    @property
    def longest_step(self) -> float:
        """What the line resolves; everything else is resolved by the default."""
        return self.line.longest_step

    def observe(self, state: ActuatorState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position and chamber pressure."""
        return state.rod.body.position, state.gas.pressure

    def signals(self, state: ActuatorState, drive: Drive) -> dict[str, Array]:
        """States and flows; `m_dot_in` comes from the atmosphere, `m_dot_out` goes to the reservoir."""
        plunger = state.plunger
        _, entering = self._port(state, self._ambient(drive), self._reservoir(0.0, drive))
        inflow, _ = self.line(self.air, state.line, entering, state.gas)
        flow = entering.mass_flow
        evacuating = plunger.position < 0
        return {
            "x_p": plunger.position,
            "v_p": plunger.velocity,
            **self.converter.magnet.signals(state.magnet),
            **self._rod.signals(state.rod, drive.turbine(0.0)),
            **self.line.signals(state.line, inflow),
            "T_act": state.gas.temperature,
            "p_act": state.gas.pressure,
            "m_dot_in": jnp.where(evacuating, 0.0, flow),
            "m_dot_out": jnp.where(evacuating, -flow, 0.0),
        }

    def typical_state(self) -> Any:
        """Millimetres, tenths of metres a second, ambient pressure and temperature."""
        gas = Gas(self.air.pressure, self.air.temperature)
        return ActuatorState(
            Plunger(1e-3, 0.1),
            self.converter.magnet.typical_state(),
            self.line.typical_state(gas),
            gas,
            self._rod.typical_state(),
        )

    @property
    def _rod(self) -> Rod:
        return Rod(self.diaphragm, self.friction, self.vane_force)

    def _ambient(self, drive: Drive) -> Scalar:
        return self.air.pressure + drive.ambient_shift

    def _reservoir(self, time: Scalar, drive: Drive) -> Scalar:
        assert drive.reservoir is not None, "a trace without one gets the assumed pressure"
        return drive.reservoir(time)

    def _drive_force(self, ambient: Scalar, pressure: Scalar) -> Scalar:
        return (ambient - pressure) * self.diaphragm.area

    def _port(self, state: ActuatorState, ambient: Scalar, reservoir: Scalar) -> tuple[Gas, Flow]:
        """What the converter sees, and the flow that leaves it."""

        def flow(into: Gas) -> Flow:
            lift = state.plunger.position
            return self.converter.flow(self.air, lift, ambient, reservoir, into.pressure, into.temperature)

        return self.line.port(self.air, state.line, state.gas, flow)
