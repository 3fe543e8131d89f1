"""The vacuum capsule: isothermal chamber and rod, which both reduced models have in common [5.2, 5.4]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ...parts import Air, Flow, Gas, IsothermalChamber, Scalar
from ...traces import Drive, Start
from .._rod import Rod, RodState


class CapsuleState(eqx.Module):
    """Pressure of the chamber in Pa absolute, and the rod: four numbers with LuGre friction."""

    pressure: Scalar
    rod: RodState


class Capsule(eqx.Module):
    """Chamber at ambient temperature, and the rod that its pressure moves."""

    chamber: IsothermalChamber
    rod: Rod
    air: Air

    def ambient(self, drive: Drive) -> Scalar:
        """Pressure of the atmosphere in Pa."""
        return self.air.pressure + drive.ambient_shift

    def start(self, start: Start, drive: Drive, working_pressure: Scalar) -> CapsuleState:
        """State at rest, as the full model has it: ambient pressure and balance, or what the trace tells.

        **Arguments:** `working_pressure` in Pa, where neither pressure nor position is known.
        """
        ambient, diaphragm = self.ambient(drive), self.rod.diaphragm
        balanced = ambient - diaphragm.balance_force(start.position) / diaphragm.area
        pressure = start.chamber_pressure(ambient, balanced, working_pressure)
        return CapsuleState(pressure, self.rod.start(start, self._drive_force(ambient, pressure)))

    def rates(self, time: Scalar, state: CapsuleState, flow: Scalar, drive: Drive) -> CapsuleState:
        """Time derivative of the state under a mass flow in kg/s into the chamber.

        `p' = (R T_atm m' + p A_d v) / V`, the last line of [5.2] and [5.4].
        """
        body, diaphragm = state.rod.body, self.rod.diaphragm
        gas = self.chamber.rates(
            self.air,
            Gas(state.pressure, self.air.temperature),
            Flow(flow, self.air.temperature),
            diaphragm.displaced_volume(body.position),
            diaphragm.displaced_volume(body.velocity),
        )
        force = self._drive_force(self.ambient(drive), state.pressure)
        return CapsuleState(gas.pressure, self.rod.rates(state.rod, force, drive.turbine(time)))

    def relaxation(self, time: Scalar, state: CapsuleState, drive: Drive) -> CapsuleState:
        """The gas is slow; the rod's rates."""
        return CapsuleState(None, self.rod.relaxation(state.rod, drive.turbine(time)))

    def signals(self, state: CapsuleState, flow: Scalar, drive: Drive) -> dict[str, Array]:
        """The rod, pressure, and the flow by its direction."""
        return {
            **self.rod.signals(state.rod, drive.turbine(0.0)),
            "p_act": state.pressure,
            "m_dot_in": jnp.maximum(flow, 0.0),
            "m_dot_out": jnp.maximum(-flow, 0.0),
        }

    def typical_state(self) -> CapsuleState:
        """Ambient pressure, and the rod's."""
        return CapsuleState(self.air.pressure, self.rod.typical_state())

    def _drive_force(self, ambient: Scalar, pressure: Scalar) -> Scalar:
        return (ambient - pressure) * self.rod.diaphragm.area
