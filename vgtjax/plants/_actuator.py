"""The full actuator: duty in, chamber pressure and position out [2.58]."""

from .._errors import InputError
from ..parameters import nested
from ..parts import AbstractChamber, AbstractFriction, AbstractLine, AbstractVaneForce, Air, Converter, Diaphragm
from ._air_path import AbstractAirPathModel, AirPath
from ._base import AbstractModel, assemble
from ._plant import AbstractPlant
from ._rod import Rod


class Actuator(AbstractAirPathModel, AbstractPlant):
    """Converter, line, chamber, diaphragm, friction and vanes, put together [2.58, corrected].

    Without arguments it has the parameters printed in the thesis's Tables B.1 to B.3.

    **Arguments:** any of its parts; or an air path and a rod, of which those parts are then replaced.
    """

    air_path: AirPath = nested()
    rod: Rod = nested()
    air: Air

    def __init__(
        self,
        converter: Converter | None = None,
        line: AbstractLine | None = None,
        chamber: AbstractChamber | None = None,
        diaphragm: Diaphragm | None = None,
        friction: AbstractFriction | None = None,
        vane_force: AbstractVaneForce | None = None,
        air: Air | None = None,
        *,
        air_path: AirPath | None = None,
        rod: Rod | None = None,
    ):
        self.air_path = assemble(air_path or AirPath(), converter=converter, line=line, chamber=chamber)
        self.rod = assemble(rod or Rod(), diaphragm=diaphragm, friction=friction, vane_force=vane_force)
        self.air = air or Air()


def as_actuator(model: AbstractModel) -> Actuator | None:
    """The full actuator that a model is in content, a plant with an [`AirPath`][vgtjax.plants.AirPath]; `None` for any
    other."""
    if isinstance(model, Actuator):
        return model
    if isinstance(model, AbstractPlant) and isinstance(model.air_path, AirPath):
        return Actuator(air_path=model.air_path, rod=model.rod, air=model.air)
    return None


def require_actuator(model: AbstractModel, what: str) -> Actuator:
    """The full actuator that a model is in content, for what is made of one.

    **Raises:** `InputError` for any other model.
    """
    actuator = as_actuator(model)
    if actuator is None:
        raise InputError(
            f"{what} the full model, an Actuator, but this is a {type(model).__name__}; give the full model"
        )
    return actuator
