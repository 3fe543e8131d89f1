"""A plant: an air path whose pressure moves a rod [2.58]."""

import equinox as eqx
from jaxtyping import Array, PyTree

from .._errors import InputError
from .._types import StateLeaf, Values
from ..parameters import nested
from ..parts import AbstractChamber, Air, Converter
from ..traces import Drive, Start
from ._air_path import AbstractAirPath, AbstractAirPathModel, AbstractConverterPath, AirPath, ambient_pressure
from ._base import AbstractModel, Inner
from ._rod import AbstractRodModel, Rod, RodState


class PlantState(eqx.Module):
    """State of air path and rod, one scalar a leaf (SI units)."""

    air_path: PyTree[StateLeaf]
    rod: RodState


class AbstractPlant(AbstractRodModel):
    """Duty in, chamber pressure and position out: an air path and a rod, coupled by the diaphragm."""

    air_path: eqx.AbstractVar[AbstractAirPath]

    chamber = Inner[AbstractChamber]("air_path")

    @property
    def needs(self) -> tuple[str, ...]:
        """A duty."""
        return ("pwm",)

    def start(self, start: Start, drive: Drive) -> PlantState:
        """State at rest: ambient pressure and static balance, or the means of the first 50 ms.

        Pressures and positions that a trace has no channel for are those of static balance.
        """
        ambient, diaphragm = ambient_pressure(self.air, drive), self.rod.diaphragm
        balanced = ambient - diaphragm.balance_force(start.position) / diaphragm.area
        working = self.air_path.working_pressure(self.air, drive)
        pressure = start.chamber_pressure(ambient, balanced, working)
        return PlantState(
            self.air_path.start(self.air, pressure, drive),
            self.rod.start(start, diaphragm.drive_force(ambient, pressure)),
        )

    def vector_field(self, time: Values, state: PlantState, drive: Drive) -> PlantState:
        """Time derivative of the state [2.58]."""
        body, diaphragm = state.rod.body, self.rod.diaphragm
        air_path = self.air_path.rates(
            self.air,
            time,
            state.air_path,
            drive,
            diaphragm.displaced_volume(body.position),
            diaphragm.displaced_volume(body.velocity),
        )
        force = diaphragm.drive_force(ambient_pressure(self.air, drive), self.air_path.pressure(state.air_path))
        return PlantState(air_path, self.rod.rates(state.rod, force, drive.turbine(time), drive.ambient_shift))

    def relaxation(self, time: Values, state: PlantState, drive: Drive) -> PlantState:
        """Rates of the air path, and of the rod with its friction and vanes."""
        displaced = self.rod.diaphragm.displaced_volume(state.rod.body.position)
        return PlantState(
            self.air_path.relaxation(self.air, state.air_path, displaced),
            self.rod.relaxation(state.rod, drive.turbine(time), self.chamber.thinness(displaced), drive.ambient_shift),
        )

    @property
    def longest_step(self) -> float:
        """That of the air path; the rod is resolved by the default."""
        return self.air_path.longest_step

    def observe(self, state: PlantState, drive: Drive) -> tuple[Values, Values]:
        """Position and chamber pressure."""
        return state.rod.body.position, self.air_path.pressure(state.air_path)

    def signals(self, state: PlantState, drive: Drive) -> dict[str, Array]:
        """All of the air path and the rod."""
        return {
            **self.air_path.signals(self.air, state.air_path, drive),
            **self.rod.signals(state.rod, drive.turbine(0.0), drive.ambient_shift),
        }

    def typical_state(self) -> PlantState:
        """Those of air path and rod."""
        return PlantState(self.air_path.typical_state(self.air), self.rod.typical_state())


class Plant(AbstractPlant):
    """Any air path with any rod; parameters have the names of the parts, for instance `diaphragm.stiffness`."""

    air_path: AbstractAirPath = nested(default_factory=AirPath)
    rod: Rod = nested(default_factory=Rod)
    air: Air = eqx.field(default_factory=Air)


def air_path_of(model: AbstractModel) -> AbstractAirPath | None:
    """A model's air path; `None` where it has none."""
    return model.air_path if isinstance(model, AbstractPlant | AbstractAirPathModel) else None


def converter_of(model: AbstractModel) -> Converter | None:
    """The converter in a model's air path; `None` where it has none."""
    path = air_path_of(model)
    return path.converter if isinstance(path, AbstractConverterPath) else None


def require_converter(model: AbstractModel, what: str) -> Converter:
    """The converter in a model's air path, for what acts on it or is designed for it.

    **Raises:** `InputError` where it has none.
    """
    converter = converter_of(model)
    if converter is None:
        raise InputError(f"{what} needs a converter, but {type(model).__name__} has none; use e.g. Actuator")
    return converter
