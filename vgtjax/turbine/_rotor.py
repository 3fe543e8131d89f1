"""The turbine's wheel."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import Part, parameter

SIZES = ("inlet_radius", "outlet_radius", "path", "outlet_area", "tail", "loading_length")
"""What must not be zero."""


class Rotor(Part):
    """A radial wheel: gas enters inwards and leaves along the axis. No source gives its sizes: all are assumed.

    **Raises:** `InputError` for sizes that are not positive, or an angle that is not below 90 deg.
    """

    place = "rotor"
    inlet_radius: Scalar = parameter(19e-3, symbol="r_3", unit="m", source="assumed", held=True)
    outlet_radius: Scalar = parameter(12e-3, symbol="r_4", unit="m", source="assumed", held=True)
    """Mean radius where the gas leaves."""
    path: Scalar = parameter(18e-3, symbol="l_r", unit="m", source="assumed", held=True)
    """Length of the mean stream line."""
    outlet_area: Scalar = parameter(700e-6, symbol="S_4", unit="m2", source="assumed", held=True)
    outlet_angle: Scalar = parameter(-58.0, symbol="beta_4", unit="deg", source="assumed", positive=False, held=True)
    """Of the relative flow from the meridional direction; negative against the rotation."""
    tail: Scalar = parameter(10e-3, symbol="l_t", unit="m", source="assumed", held=True)
    """Of the duct behind the wheel."""
    loading_length: Scalar = parameter(0.12, symbol="l_3", unit="-", source="assumed", held=True)
    """Share of the path over which gas takes the blades' angle."""
    blades: int = eqx.field(static=True, default=9)
    """Number of them, for laws of losses; assumed."""

    def __check_init__(self) -> None:
        self.require_working()

    def require_working(self) -> None:
        """**Raises:** `InputError` as above, for values that were put in later as well."""
        if self.blades < 3:
            raise InputError(f"rotor.blades must be at least 3, but it is {self.blades}; give the number of blades")
        for name in SIZES:
            require_positive(f"rotor.{name}", getattr(self, name), "size", "a wheel without it lets no gas through")
        if not is_traced(self.outlet_angle) and not np.all(np.abs(self.outlet_angle) < 90.0):
            raise InputError(
                f"rotor.outlet_angle must be between -90 and 90 deg, but it is {self.outlet_angle}; count it from the "
                "meridional direction"
            )

    def works(self) -> Bool[Array, "..."]:
        """Whether gas can flow through it, also where it is traced; `require_working` says why not."""
        sizes = [getattr(self, name) > 0 for name in SIZES]
        return functools.reduce(jnp.logical_and, [jnp.abs(self.outlet_angle) < 90.0, *sizes])

    def radius(self, share: Values) -> Values:
        """In m, after a share of the path."""
        return self.inlet_radius + (self.outlet_radius - self.inlet_radius) * (1 - jnp.cos(0.5 * jnp.pi * share))

    def area(self, share: Values, height: Values) -> Values:
        """In m2, after a share of the path; `height` of the blades in m where the gas enters."""
        inlet = 2 * jnp.pi * self.inlet_radius * height
        return inlet + (self.outlet_area - inlet) * smooth_step(share)

    def tangent(self, share: Values) -> Values:
        """Of the blades' angle after a share of the path."""
        return jnp.tan(jnp.radians(self.outlet_angle)) * share**2


def smooth_step(share: Values) -> Values:
    """From 0 to 1, level at both ends."""
    inside = jnp.clip(share, 0.0, 1.0)
    return inside**2 * (3 - 2 * inside)
