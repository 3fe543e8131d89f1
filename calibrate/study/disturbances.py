"""Tables of what disturbs a bench without its sensors showing it: `[pulsation]`."""

from typing import Annotated, Any, Literal, Protocol

import pydantic

import vgtjax
from vgtjax.exhaust import ASSUMED, Engine, OperatingPoint, PressurePulsation

from .base import Positive, Table


class Disturbance(Protocol):
    """What a table of a disturbance builds."""

    def applied(self, trace: vgtjax.Trace) -> vgtjax.Trace:
        """The trace as the actuator felt it."""


class PulsationTable(Table):
    """An engine whose firing makes the turbine pressure of every trace pulsate about what the trace says.

    The operating point is that of an assumed engine under load at 1000 rpm; the area stands for its turbine.
    """

    engine_speed: Annotated[float, pydantic.Field(ge=400, le=1e4)]
    """rpm; below 400 no engine runs, and the steps of its cycle are too long."""
    amplitude: Literal["engine"] | float = "engine"
    """That of the engine, or half of it from peak to peak as a share between 0 and 1 of the mean gauge pressure."""
    trapped_mass: Annotated[float, pydantic.Field(gt=0, le=1e-2)] = ASSUMED["trapped_mass"]
    """kg in a cylinder."""
    opening_temperature: Annotated[float, pydantic.Field(ge=300, le=3000)] = ASSUMED["opening_temperature"]
    """K of the gas when the exhaust valve opens."""
    outlet_pressure: Annotated[float, pydantic.Field(ge=3e4, le=1e6)] = ASSUMED["outlet_pressure"]
    """Pa absolute behind the turbine."""
    effective_area: Positive = ASSUMED["effective_area"]
    """m2 of the orifice that stands for the turbine."""

    @pydantic.field_validator("amplitude", mode="before")
    @classmethod
    def _engine_or_share(cls, amplitude: Any) -> Any:
        number = isinstance(amplitude, int | float) and not isinstance(amplitude, bool)
        if amplitude != "engine" and not (number and 0 < amplitude < 1):
            raise ValueError(
                "pulsation.amplitude must be 'engine' or a share of the mean gauge pressure between 0 and 1, but it is "
                f"{amplitude!r}; write e.g. 0.2"
            )
        return amplitude

    def build(self) -> PressurePulsation:
        """The pulsation of that engine.

        **Raises:** `SimulationError` when the engine has no periodic cycle there.
        """
        point = OperatingPoint(
            self.engine_speed, self.trapped_mass, self.opening_temperature, self.outlet_pressure, self.effective_area
        )
        return PressurePulsation.of(Engine(), point, None if self.amplitude == "engine" else float(self.amplitude))
