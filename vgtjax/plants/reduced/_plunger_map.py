"""The reduced model with six states: flow as a map of plunger position and pressure [5.2]."""

import functools
import math

import equinox as eqx
from jaxtyping import Array

from ..._errors import InputError
from ..._types import StateLeaf, Values
from ...parameters import nested
from ...parts import (
    AbstractFriction,
    AbstractLiftMap,
    AbstractVaneForce,
    Air,
    Converter,
    ConverterState,
    Diaphragm,
    IsothermalChamber,
)
from ...traces import Drive
from .._actuator import require_actuator
from .._air_path import AbstractConverterPath, ambient_pressure, reservoir_pressure
from .._base import AbstractModel, Inner, assemble
from .._plant import AbstractPlant
from .._rod import Rod
from ._fitting import FlowMap, fit_flow_map, printed_flow_map
from ._gas import flow_signals, parts_around, pressure_rate


class LiftMapState(eqx.Module):
    """State of the converter, and chamber pressure in Pa absolute."""

    converter: ConverterState
    pressure: StateLeaf


class LiftMapPath(AbstractConverterPath):
    """Plunger, a map of flow over its position, and an isothermal chamber [5.2, with the signs of 2.7].

    [5.2] counts the plunger's position the other way (erratum). Of the converter only the plunger and the magnetic
    force count: the map takes the place of both orifices, whose parameters then do nothing.
    """

    flow_map: AbstractLiftMap = eqx.field(default_factory=functools.partial(printed_flow_map, "lift-table"))
    converter: Converter = eqx.field(default_factory=Converter)
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)

    def start(self, air: Air, pressure: Values, drive: Drive) -> LiftMapState:
        """The plunger balanced."""
        reservoir = reservoir_pressure(0.0, drive)
        return LiftMapState(
            self.converter.start(drive.pwm, ambient_pressure(air, drive), reservoir, pressure), pressure
        )

    def pressure(self, state: LiftMapState) -> Values:
        """A state of its own."""
        return state.pressure

    def rates(
        self, air: Air, time: Values, state: LiftMapState, drive: Drive, displaced: Values, displacement_rate: Values
    ) -> LiftMapState:
        """Time derivative of the state [5.2]."""
        ambient, reservoir = ambient_pressure(air, drive), reservoir_pressure(time, drive)
        flow = self._flow(air, state, drive)
        return LiftMapState(
            self.converter.rates(state.converter, drive.pwm, ambient, reservoir, state.pressure),
            pressure_rate(air, self.chamber, state.pressure, flow, displaced, displacement_rate),
        )

    def relaxation(self, air: Air, state: LiftMapState, displaced: Values) -> LiftMapState:
        """Rates of the plunger and the magnet; the gas is slow."""
        return LiftMapState(self.converter.relaxation(state.converter), None)

    def signals(self, air: Air, state: LiftMapState, drive: Drive) -> dict[str, Array]:
        """States and flow."""
        return {
            **self.converter.signals(state.converter),
            **flow_signals(state.pressure, self._flow(air, state, drive)),
        }

    def typical_state(self, air: Air) -> LiftMapState:
        """That of the converter, and ambient pressure."""
        return LiftMapState(self.converter.typical_state(), air.pressure)

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def _flow(self, air: Air, state: LiftMapState, drive: Drive) -> Values:
        return self.flow_map(state.converter.plunger.position, state.pressure, ambient_pressure(air, drive))


class PlungerMapActuator(AbstractPlant):
    """Plunger, flow map, isothermal chamber, diaphragm, friction and vanes [5.2].

    Six states with LuGre friction and the static magnetic force. [`reduce_to_plunger_map`][] makes one from a full
    actuator; without arguments it is that of the printed one.

    **Arguments:** any of its parts; or an air path and a rod, of which those parts are then replaced.
    """

    air_path: LiftMapPath = nested()
    rod: Rod = nested()
    air: Air

    def __init__(
        self,
        flow_map: AbstractLiftMap | None = None,
        converter: Converter | None = None,
        chamber: IsothermalChamber | None = None,
        diaphragm: Diaphragm | None = None,
        friction: AbstractFriction | None = None,
        vane_force: AbstractVaneForce | None = None,
        air: Air | None = None,
        *,
        air_path: LiftMapPath | None = None,
        rod: Rod | None = None,
    ):
        # A map that is given is not fitted first.
        path = air_path or (LiftMapPath() if flow_map is None else LiftMapPath(flow_map=flow_map))
        self.air_path = assemble(path, flow_map=flow_map, converter=converter, chamber=chamber)
        self.rod = assemble(rod or Rod(), diaphragm=diaphragm, friction=friction, vane_force=vane_force)
        self.air = air or Air()

    flow_map = Inner[AbstractLiftMap]("air_path")
    converter = Inner[Converter]("air_path")


def reduce_to_plunger_map(model: AbstractModel, flow_map: FlowMap | None = None) -> PlungerMapActuator:
    """The model with six states [5.2] of a full actuator.

    **Arguments:** `flow_map`: over plunger position and pressure, by default fitted to `model`.

    **Raises:** `InputError` for a map over duty, or for another model.
    """
    full = require_actuator(model, "a reduced model is made of")
    found = fit_flow_map(full, "lift-table").flow_map if flow_map is None else flow_map
    if not isinstance(found, AbstractLiftMap):
        raise InputError(
            f"the model with six states needs a map over plunger position, but this is a {type(found).__name__}; "
            "fit one of kind 'lift-table'"
        )
    return PlungerMapActuator(converter=full.converter, **parts_around(found, full))
