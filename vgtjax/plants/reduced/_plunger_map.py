"""The reduced model with six states: flow as a map of plunger position and pressure [5.2]."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...parts import (
    AbstractFriction,
    AbstractLiftMap,
    AbstractVaneForce,
    Air,
    Converter,
    Diaphragm,
    IsothermalChamber,
    LuGre,
    NoVaneForce,
    Plunger,
    Scalar,
)
from ...traces import Drive, Start
from .._actuator import Actuator
from .._base import AbstractModel
from .._rod import Rod
from ._capsule import Capsule, CapsuleState
from ._fitting import fit_flow_map


class PlungerMapState(eqx.Module):
    """State of the model, one scalar a leaf (SI units): six with LuGre friction and the static magnetic force."""

    plunger: Plunger
    magnet: PyTree[Array]
    capsule: CapsuleState


def _printed_actuators() -> Any:
    with jax.ensure_compile_time_eval():  # also where a model is made under jit
        return fit_flow_map(Actuator(), "lift-table").flow_map


class PlungerMapActuator(AbstractModel):
    """Plunger, flow map, isothermal chamber, diaphragm, friction and vanes [5.2, with the signs of 2.7].

    [5.2] counts the plunger's position the other way (erratum 7). Of the converter only the plunger and the magnetic
    force count: the map takes the place of both orifices, whose parameters then do nothing. [`reduce_to_plunger_map`][]
    makes one from a full actuator; without arguments it is that of the printed one.
    """

    flow_map: AbstractLiftMap = eqx.field(default_factory=_printed_actuators)
    converter: Converter = eqx.field(default_factory=Converter)
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: AbstractFriction = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    air: Air = eqx.field(default_factory=Air)

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty."""
        return ("pwm",)

    def start(self, start: Start, drive: Drive) -> PlungerMapState:
        """State at rest, as the full model has it."""
        ambient, reservoir = self._capsule.ambient(drive), self._reservoir(0.0, drive)
        working = self.converter.working_pressure(drive.pwm, ambient, reservoir)
        capsule = self._capsule.start(start, drive, working)
        lift = self.converter.rest_position(drive.pwm, ambient, reservoir, capsule.pressure)
        return PlungerMapState(
            Plunger(lift, jnp.zeros_like(lift)), self.converter.magnet.initial_state(drive.pwm), capsule
        )

    def vector_field(self, time: Scalar, state: PlungerMapState, drive: Drive) -> PlungerMapState:
        """Time derivative of the state [5.2]."""
        plunger, ambient = state.plunger, self._capsule.ambient(drive)
        pull, magnet_rate = self.converter.magnet(drive.pwm, plunger.position, plunger.velocity, state.magnet)
        lift_rate = self.converter.acceleration(
            plunger, pull, ambient, self._reservoir(time, drive), state.capsule.pressure
        )
        return PlungerMapState(
            Plunger(plunger.velocity, lift_rate),
            magnet_rate,
            self._capsule.rates(time, state.capsule, self._flow(state, drive), drive),
        )

    def relaxation(self, time: Scalar, state: PlungerMapState, drive: Drive) -> PlungerMapState:
        """Rates of the plunger, the coil, and the rod with its friction and vanes."""
        return PlungerMapState(
            Plunger(None, self.converter.damping_rate()),
            self.converter.magnet.relaxation(state.plunger.position, state.magnet),
            self._capsule.relaxation(time, state.capsule, drive),
        )

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def observe(self, state: PlungerMapState, drive: Drive) -> tuple[Scalar, Scalar]:
        """Position and chamber pressure."""
        return state.capsule.rod.body.position, state.capsule.pressure

    def signals(self, state: PlungerMapState, drive: Drive) -> dict[str, Array]:
        """States and flow."""
        return {
            "x_p": state.plunger.position,
            "v_p": state.plunger.velocity,
            **self.converter.magnet.signals(state.magnet),
            **self._capsule.signals(state.capsule, self._flow(state, drive), drive),
        }

    def typical_state(self) -> Any:
        """Millimetres, tenths of metres a second, and that of the capsule."""
        return PlungerMapState(Plunger(1e-3, 0.1), self.converter.magnet.typical_state(), self._capsule.typical_state())

    @property
    def _capsule(self) -> Capsule:
        return Capsule(self.chamber, Rod(self.diaphragm, self.friction, self.vane_force), self.air)

    def _flow(self, state: PlungerMapState, drive: Drive) -> Scalar:
        return self.flow_map(state.plunger.position, state.capsule.pressure, self._capsule.ambient(drive))

    def _reservoir(self, time: Scalar | float, drive: Drive) -> Scalar:
        assert drive.reservoir is not None, "a trace without one gets the assumed pressure"
        return drive.reservoir(time)
