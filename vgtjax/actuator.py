"""The full actuator: duty in, chamber pressure and position out [2.58]."""

from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .air import Air, Scalar
from .chamber import AdiabaticChamber, Gas
from .converter import Converter, Flow, Plunger
from .diaphragm import Body, Diaphragm
from .drive import Drive, Start
from .friction import AbstractFriction, LuGre
from .line import AbstractLine, NoLine
from .model import AbstractModel
from .vane_force import AbstractVaneForce, NoVaneForce


class ActuatorState(eqx.Module):
    """State of the full actuator, one scalar a leaf (SI units)."""

    plunger: Plunger
    line: PyTree[Array]
    gas: Gas
    body: Body
    friction: PyTree[Array]
    vanes: PyTree[Array]


class Actuator(AbstractModel):
    """Converter, line, chamber, diaphragm, friction and vanes, put together [2.58, corrected].

    Without arguments it has the parameters printed in the thesis's Tables B.1 to B.3.
    """

    converter: Converter = eqx.field(default_factory=Converter)
    line: AbstractLine = eqx.field(default_factory=NoLine)
    chamber: AdiabaticChamber = eqx.field(default_factory=AdiabaticChamber)
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
        unknown = jnp.where(
            start.position_known, balanced, self.converter.working_pressure(drive.pwm, ambient, reservoir)
        )
        pressure = jnp.where(start.pressure_known, start.pressure, unknown)
        pressure = jnp.where(start.at_rest, ambient, pressure)
        body = self.diaphragm.start(start, self._drive_force(ambient, pressure))
        gas = Gas(pressure, jnp.broadcast_to(self.air.temperature, jnp.shape(pressure)))
        lift = self.converter.rest_position(drive.pwm, ambient, reservoir, pressure)
        return ActuatorState(
            Plunger(lift, jnp.zeros_like(lift)),
            self.line.initial_state(gas),
            gas,
            body,
            self.friction.initial_state(),
            self.vane_force.initial_state(),
        )

    def vector_field(self, time: Scalar, state: ActuatorState, drive: Drive) -> ActuatorState:
        """Time derivative of the state [2.58]."""
        ambient, reservoir = self._ambient(drive), self._reservoir(time, drive)
        plunger, gas, body = state.plunger, state.gas, state.body
        inflow, line_rate = self._inflow(state, ambient, reservoir)
        force = self._drive_force(ambient, gas.pressure)
        vane_force, vane_rate = self.vane_force(body, self.diaphragm.travel, state.vanes, drive.turbine(time))
        applied = self.diaphragm.applied_force(body, force - vane_force)
        friction_force, friction_rate = self.friction(body.velocity, state.friction, applied)
        return ActuatorState(
            Plunger(
                plunger.velocity,
                self.converter.acceleration(plunger, drive.pwm, ambient, reservoir, gas.pressure),
            ),
            line_rate,
            self.chamber.rates(
                self.air,
                gas,
                inflow,
                self.diaphragm.displaced_volume(body.position),
                self.diaphragm.displaced_volume(body.velocity),
            ),
            Body(body.velocity, (applied - friction_force) / self.diaphragm.mass),
            friction_rate,
            vane_rate,
        )

    def relaxation(self, state: ActuatorState) -> ActuatorState:
        """Rates of the plunger, the rod and the bristles; the gas is slow."""
        return ActuatorState(
            Plunger(None, self.converter.damping_rate()),
            self.line.relaxation(state.line),
            Gas(None, None),
            Body(None, self.diaphragm.damping_rate(self.friction.damping())),
            self.friction.relaxation(state.body.velocity),
            self.vane_force.relaxation(state.body, state.vanes),
        )

    def observe(self, state: ActuatorState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position and chamber pressure."""
        return state.body.position, state.gas.pressure

    def signals(self, state: ActuatorState, drive: Drive) -> dict[str, Array]:
        """States and flows; `m_dot_in` comes from the atmosphere, `m_dot_out` goes to the reservoir."""
        flow = self._converter_flow(
            state, self._ambient(drive), self._reservoir(0.0, drive), state.gas.pressure, state.gas.temperature
        ).mass_flow
        evacuating = state.plunger.position < 0
        return {
            "x_p": state.plunger.position,
            "v_p": state.plunger.velocity,
            "x_d": state.body.position,
            "v_d": state.body.velocity,
            **self.friction.signals(state.friction),
            **self.vane_force.signals(state.vanes),
            **self.line.signals(state.line),
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
            self.line.typical_state(gas),
            gas,
            Body(1e-2, 0.1),
            self.friction.typical_state(),
            self.vane_force.typical_state(),
        )

    def _ambient(self, drive: Drive) -> Scalar:
        return self.air.pressure + drive.ambient_shift

    def _reservoir(self, time: Scalar, drive: Drive) -> Scalar:
        assert drive.reservoir is not None, "a trace without one gets the assumed pressure"
        return drive.reservoir(time)

    def _drive_force(self, ambient: Scalar, pressure: Scalar) -> Scalar:
        return (ambient - pressure) * self.diaphragm.area

    def _converter_flow(
        self, state: ActuatorState, ambient: Scalar, reservoir: Scalar, pressure: Scalar, temperature: Scalar
    ) -> Flow:
        lift = state.plunger.position
        return self.converter.flow(self.air, lift, ambient, reservoir, pressure, temperature)

    def _inflow(self, state: ActuatorState, ambient: Scalar, reservoir: Scalar) -> tuple[Flow, PyTree[Array]]:
        source = partial(self._converter_flow, state, ambient, reservoir)
        return self.line(self.air, state.line, source, state.gas)
