"""What an engine is run at, and through what its manifold empties."""

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import as_float_array, optional_float_array
from ..parts import flow_between
from ._gas import ExhaustGas


@runtime_checkable
class TurbineFlow(Protocol):
    """What a turbine has to answer for a manifold to empty through it."""

    total_temperature: Scalar
    """K at the inlet, for which `mass_flow` holds."""
    outlet_pressure: Scalar
    """Pa absolute behind it, for which `mass_flow` holds."""

    def mass_flow(self, total_pressure: Values, crank_angle: Values) -> Values:
        """Flow in kg/s from a total pressure in Pa absolute, with the vanes' crank at an angle in deg."""


UNITS = {
    "engine_speed": "speed in rpm",
    "trapped_mass": "mass in kg",
    "opening_temperature": "temperature in K",
    "outlet_pressure": "pressure in Pa absolute",
    "effective_area": "area in m2",
}
"""What must be positive, and its unit."""


ASSUMED: dict[str, float] = {
    "engine_speed": 1000.0,
    "trapped_mass": 0.476e-3,
    "opening_temperature": 1150.0,
    "outlet_pressure": 1.03e5,
    "effective_area": 87e-6,
}
"""Of an engine under load; nothing of it was ever measured."""


class OperatingPoint(eqx.Module):
    """A point at which an engine runs; numbers, or arrays of one shape for a batch under `jax.vmap`.

    Exactly one of `effective_area` and `turbine` says how the manifold empties; a turbine also needs the `crank_angle`
    of its vanes.

    **Raises:** `InputError` for a quantity that is not positive, for both ways out of the manifold or none, for a
    turbine without an angle or the other way round, and for one with another pressure behind it.
    """

    engine_speed: Values = eqx.field(converter=as_float_array)
    """rpm"""
    trapped_mass: Values = eqx.field(converter=as_float_array)
    """kg of gas in a cylinder when its exhaust valve opens."""
    opening_temperature: Values = eqx.field(converter=as_float_array)
    """K of that gas."""
    outlet_pressure: Values = eqx.field(converter=as_float_array)
    """Pa absolute behind the turbine."""
    effective_area: Values | None = eqx.field(converter=optional_float_array, default=None)
    """m2 of the orifice that stands for the turbine."""
    turbine: Any = None
    """See [`TurbineFlow`][]. `Any`, as a check of annotations would be before the sentence of `__check_init__`."""
    crank_angle: Values | None = eqx.field(converter=optional_float_array, default=None)
    """deg of the crank that turns the turbine's vanes."""

    @classmethod
    def assumed(cls) -> "OperatingPoint":
        """The usual engine under load at 1000 rpm, with an orifice of 87 mm2 that stands for its turbine; nothing of it
        was ever measured."""
        return cls(**ASSUMED)

    def __check_init__(self) -> None:
        for name, what in UNITS.items():
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name), what, f"correct {name}")
        if (self.effective_area is None) == (self.turbine is None):
            given = "neither" if self.turbine is None else "both"
            raise InputError(
                "a manifold must empty through either an effective_area or a turbine, but there is "
                f"{given}; give exactly one"
            )
        if (self.turbine is None) != (self.crank_angle is None):
            raise InputError(
                "a turbine and the crank_angle of its vanes belong together, but only "
                f"{'the angle' if self.turbine is None else 'the turbine'} is given; give both or none"
            )
        if self.turbine is not None and not isinstance(self.turbine, TurbineFlow):
            raise InputError(
                "a turbine must have mass_flow(total_pressure, crank_angle), total_temperature and outlet_pressure, "
                f"but {type(self.turbine).__name__} has not; give e.g. a vane force of a turbine"
            )
        if self.turbine is not None:
            self._require_one_outlet(self.turbine)

    def _require_one_outlet(self, turbine: TurbineFlow) -> None:
        here, there = self.outlet_pressure, turbine.outlet_pressure
        if not is_traced(here, there) and not np.allclose(here, there, rtol=1e-6):
            raise InputError(
                f"the pressure behind the turbine must be the {np.mean(there):.6g} Pa of its flow, but outlet_pressure "
                f"is {np.mean(here):.6g} Pa; give one of them to both",
                "outlet_pressure",
            )

    def leaving(self, gas: ExhaustGas, pressure: Values, temperature: Values) -> Values:
        """Mass flow in kg/s from a manifold at a pressure in Pa absolute and a temperature in K into the turbine.

        What a turbine takes in goes as `p0 / sqrt(T0)`; nothing comes back through it. Gas that comes back through an
        orifice is what has left through it, whose total temperature, the manifold's, it has kept.
        """
        if self.turbine is not None:
            hotter = temperature / self.turbine.total_temperature
            return self.turbine.mass_flow(pressure, self.crank_angle) / jnp.sqrt(hotter)
        return flow_between(gas, self.effective_area, pressure, temperature, self.outlet_pressure, temperature)[0]
