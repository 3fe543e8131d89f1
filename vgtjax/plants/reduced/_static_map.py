"""The model for control with four states: flow as a map of duty and pressure [5.4]."""

import functools
import math

import equinox as eqx
from jaxtyping import Array

from ..._errors import InputError
from ..._types import Values
from ...parameters import nested
from ...parts import AbstractFlowMap, AbstractFriction, AbstractVaneForce, Air, Diaphragm, IsothermalChamber
from ...traces import Drive
from .._actuator import require_actuator
from .._air_path import AbstractAirPath, ambient_pressure
from .._base import AbstractModel, Inner, assemble
from .._plant import AbstractPlant
from .._rod import Rod
from ._fitting import FlowMap, fit_flow_map, printed_flow_map
from ._gas import flow_signals, parts_around, pressure_rate


class FlowMapPath(AbstractAirPath):
    """A map of flow over duty and pressure, and an isothermal chamber [5.4]; the plunger follows at once.

    Its state is the chamber pressure. The reservoir's pressure is that of the map, whatever a trace says.
    """

    flow_map: AbstractFlowMap = eqx.field(default_factory=functools.partial(printed_flow_map, "steady-plunger"))
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)

    def working_pressure(self, air: Air, drive: Drive) -> Values:
        """That of the map."""
        return self.flow_map.working_pressure(drive.pwm, ambient_pressure(air, drive))

    def start(self, air: Air, pressure: Values, drive: Drive) -> Values:
        """The pressure."""
        return pressure

    def pressure(self, state: Values) -> Values:
        """The state."""
        return state

    def rates(
        self, air: Air, time: Values, state: Values, drive: Drive, displaced: Values, displacement_rate: Values
    ) -> Values:
        """Time derivative of the pressure in Pa/s [5.4]."""
        flow = self._flow(air, state, drive)
        return pressure_rate(air, self.chamber, state, flow, displaced, displacement_rate)

    def relaxation(self, air: Air, state: Values, displaced: Values) -> None:
        """The gas is slow."""

    def signals(self, air: Air, state: Values, drive: Drive) -> dict[str, Array]:
        """Pressure and flow."""
        return flow_signals(state, self._flow(air, state, drive))

    def typical_state(self, air: Air) -> Values:
        """Ambient pressure."""
        return air.pressure

    @property
    def longest_step(self) -> float:
        """The default resolves it."""
        return math.inf

    def _flow(self, air: Air, pressure: Values, drive: Drive) -> Values:
        return self.flow_map(drive.pwm, pressure, ambient_pressure(air, drive))


class StaticMapActuator(AbstractPlant):
    """Flow map, isothermal chamber, diaphragm, friction and vanes [5.4].

    Position, velocity, bristles and pressure are four states with LuGre friction; other friction and vane forces bring
    their own. [`reduce_to_static_map`][] makes one from a full actuator; without arguments it is that of the printed
    one.

    **Arguments:** any of its parts; or an air path and a rod, of which those parts are then replaced.
    """

    air_path: FlowMapPath = nested()
    rod: Rod = nested()
    air: Air

    def __init__(
        self,
        flow_map: AbstractFlowMap | None = None,
        chamber: IsothermalChamber | None = None,
        diaphragm: Diaphragm | None = None,
        friction: AbstractFriction | None = None,
        vane_force: AbstractVaneForce | None = None,
        air: Air | None = None,
        *,
        air_path: FlowMapPath | None = None,
        rod: Rod | None = None,
    ):
        # A map that is given is not fitted first.
        path = air_path or (FlowMapPath() if flow_map is None else FlowMapPath(flow_map=flow_map))
        self.air_path = assemble(path, flow_map=flow_map, chamber=chamber)
        self.rod = assemble(rod or Rod(), diaphragm=diaphragm, friction=friction, vane_force=vane_force)
        self.air = air or Air()

    flow_map = Inner[AbstractFlowMap]("air_path")


def reduce_to_static_map(model: AbstractModel, flow_map: FlowMap | None = None) -> StaticMapActuator:
    """The model with four states [5.4] of a full actuator.

    **Arguments:** `flow_map`: over duty and pressure, by default the steady plunger's, fitted to `model`.

    **Raises:** `InputError` for a map over plunger position, or for another model.
    """
    full = require_actuator(model, "a reduced model is made of")
    found = fit_flow_map(full).flow_map if flow_map is None else flow_map
    if not isinstance(found, AbstractFlowMap):
        raise InputError(
            f"the model with four states needs a map over duty, but this is a {type(found).__name__}; fit one of kind "
            "'steady-plunger' or 'polynomial'"
        )
    return StaticMapActuator(**parts_around(found, full))
