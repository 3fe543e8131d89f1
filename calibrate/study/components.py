"""`[components]`: which variant of each part; which there are depends on the study's model."""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, Literal

import vgtjax

from .base import Table

Friction = Literal["lugre", "lugre-squared", "lugre-passive", "adaptive-lugre", "dahl", "karnopp", "coulomb"]
VaneForce = Literal["none", "polynomial", "map", "speed-map", "turbine", "turbine-at-speed"]
Line = Literal["none", "delay", "wave"]
MagneticForce = Literal["static", "coil"]
Chamber = Literal["adiabatic", "wall", "isothermal"]

FRICTION: dict[Friction, Callable[[], vgtjax.AbstractFriction]] = {
    "lugre": vgtjax.LuGre,
    "lugre-squared": functools.partial(vgtjax.LuGre, stribeck_exponent=2),
    "lugre-passive": vgtjax.PassiveLuGre,  # type: ignore[dict-item]  # mypy takes its abstract variables for fields
    "adaptive-lugre": vgtjax.AdaptiveLuGre,
    "dahl": vgtjax.Dahl,
    "karnopp": vgtjax.Karnopp,
    "coulomb": vgtjax.Coulomb,
}
VANE_FORCE: dict[VaneForce, Callable[[], vgtjax.AbstractVaneForce]] = {
    "none": vgtjax.NoVaneForce,
    "polynomial": vgtjax.ForcePolynomial,
    "map": vgtjax.HysteresisMap,
    "speed-map": vgtjax.SpeedMap,
    "turbine": vgtjax.Turbine,
    "turbine-at-speed": functools.partial(vgtjax.Turbine, wheel_speed=vgtjax.parts.WHEEL_SPEED),
}
TURBINES = ("turbine", "turbine-at-speed")
"""Those with a nozzle: the wheel turns by a ratio to the gas, or at a speed of its own."""
LINE: dict[Line, Callable[[], vgtjax.AbstractLine]] = {
    "none": vgtjax.NoLine,
    "delay": vgtjax.DelayLine,
    "wave": vgtjax.WaveLine,
}
CHAMBER: dict[Chamber, Callable[[], vgtjax.AbstractChamber]] = {
    "adiabatic": vgtjax.AdiabaticChamber,
    "wall": vgtjax.WallChamber,
    "isothermal": vgtjax.IsothermalChamber,
}
MAGNETIC_FORCE: dict[MagneticForce, Callable[[], vgtjax.Converter]] = {
    "static": vgtjax.Converter,
    "coil": lambda: vgtjax.Converter(magnetic_force=vgtjax.Coil()),
}


class Components(Table):
    """What every model has."""

    friction: Friction = "lugre"
    """Between rod and guide."""
    vane_force: VaneForce = "none"
    """Of the exhaust gas on the vanes."""

    def names(self) -> dict[str, Any]:
        """The name of every component, as files state it.

        They name all components of the full model whatever a model leaves out, so that files of all models look alike.
        """
        stated = self.model_dump(exclude_none=True)
        return FullComponents().model_dump() | stated

    def rod(self) -> dict[str, Any]:
        """Friction and vane force by the name of their fields."""
        return {"friction": FRICTION[self.friction](), "vane_force": VANE_FORCE[self.vane_force]()}


class FullComponents(Components):
    """Of `model = "full"`."""

    line: Line = "none"
    """The hose between converter and chamber."""
    magnetic_force: MagneticForce = "static"
    """A curve over the duty, or that of a coil with its current."""
    chamber: Chamber = "adiabatic"
    """What heat its gas exchanges: none, some with the wall, or as much as keeps its temperature."""

    def build(self) -> vgtjax.Actuator:
        """The actuator with printed parameters."""
        return vgtjax.Actuator(
            converter=MAGNETIC_FORCE[self.magnetic_force](),
            line=LINE[self.line](),
            chamber=CHAMBER[self.chamber](),
            **self.rod(),
        )


class MechanicalComponents(Components):
    """Of `model = "mechanical"`: what it leaves out may be named as long as it is the default."""

    line: Literal["none"] | None = None
    """It has none."""
    magnetic_force: Literal["static"] | None = None
    """It has none."""
    chamber: Literal["adiabatic"] | None = None
    """It has none."""

    def build(self) -> vgtjax.MechanicalActuator:
        """The rod with printed parameters."""
        return vgtjax.MechanicalActuator(**self.rod())


class ReducedComponents(Components):
    """Of a reduced model: its gas is isothermal, and no hose is between converter and chamber."""

    line: Literal["none"] | None = None
    """It has none."""
    magnetic_force: MagneticForce = "static"
    """A curve over the duty, or that of a coil with its current."""
    chamber: Literal["isothermal"] | None = None
    """Its gas keeps its temperature."""
    flow_map: str | None = None
    """What stands for the orifices; the first one if it is left out."""

    flow_maps: ClassVar[dict[str, str]]
    """Kinds of [`fit_flow_map`][vgtjax.fit_flow_map] by the names in a study; the first is the default."""
    reduction: ClassVar[Callable[[vgtjax.Actuator, Any], vgtjax.AbstractModel]]
    """The model with a flow map in the place of the actuator's converter."""

    @property
    def usual_map(self) -> str:
        """What `flow_map` is if it is left out."""
        return next(iter(self.flow_maps))

    def full(self) -> vgtjax.Actuator:
        """The actuator whose flow the map describes."""
        return vgtjax.Actuator(converter=MAGNETIC_FORCE[self.magnetic_force](), **self.rod())

    def reduce(self, full: vgtjax.Actuator) -> vgtjax.AbstractModel:
        """The reduced model, its flow map fitted to the converter of `full`."""
        kind: Any = self.flow_maps[self.flow_map or self.usual_map]
        return type(self).reduction(full, vgtjax.fit_flow_map(full, kind).flow_map)


class PlungerMapComponents(ReducedComponents):
    """Of `model = "plunger-map"`."""

    flow_map: Literal["table"] | None = None
    flow_maps: ClassVar[dict[str, str]] = {"table": "lift-table"}
    reduction = staticmethod(vgtjax.reduce_to_plunger_map)


class StaticMapComponents(ReducedComponents):
    """Of `model = "static-map"`."""

    flow_map: Literal["steady-plunger", "polynomial", "printed"] | None = None
    flow_maps: ClassVar[dict[str, str]] = {name: name for name in ("steady-plunger", "polynomial", "printed")}
    reduction = staticmethod(vgtjax.reduce_to_static_map)
