"""What gas flows through, and what it comes from."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError, is_traced, require_finite, require_positive
from .._types import Values
from ._gas import Gas

Faces = Float[Array | np.ndarray, " faces"]
Cells = Float[Array | np.ndarray, " cells"]
LEAST_CELLS = 4
"""Fewer have no inside: a cell feels two neighbours on either side."""
NAMES = {
    "m": "distances along the passage in m, increasing",
    "radius": "radii in m above zero",
    "area": "areas in m2 above zero",
    "tangent": "tangents of a row's relative flow angle",
    "length": "lengths in m above zero",
    "speed": "speeds in rad/s",
    "friction": "friction coefficients in 1/m, not negative",
    "heat": "heat in W/m3",
}


class Passage(eqx.Module):
    """A passage of revolution, cut into cells along its mean stream surface [3.21-3.25].

    **Raises:** `InputError` for arrays that don't fit each other, radii, areas or lengths that are not positive, and
    distances that don't increase.
    """

    m: Faces
    """Distance along the passage at the faces, in m."""
    radius: Faces
    """Distance of the faces from the axis, in m."""
    area: Faces
    """Area of the faces normal to the meridional velocity, in m2."""
    row: Int[Array | np.ndarray, " cells"]
    """Which row of blades a cell belongs to; 0 for none."""
    tangent: Cells
    """Of the angle that a row turns the gas to, relative to the row, from the meridional direction [3.48, E9]."""
    length: Cells
    """Meridional length in m over which the gas takes that angle."""
    speed: Cells
    """Of the row in rad/s."""
    friction: Cells
    """Energy-loss coefficient over chord, in 1/m [3.58, E12, E14]."""
    heat: Cells
    """Heat that the gas takes up, in W/m3; negative where it is cooled [3.35]."""

    def __check_init__(self) -> None:
        arrays = {name: getattr(self, name) for name in NAMES}
        cells = np.shape(self.row)[-1]
        for name, array in arrays.items():
            wanted = cells + (name in ("m", "radius", "area"))
            if np.shape(array) != (wanted,) or cells < LEAST_CELLS:
                raise InputError(
                    f"passage.{name} must be {wanted} {NAMES[name]} for {cells} cells, at least {LEAST_CELLS}, but its "
                    f"shape is {np.shape(array)}; faces have one more than cells",
                    name,
                )
            if not is_traced(array):
                _check_values(name, np.asarray(array, float))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.row.shape[-1]

    @property
    def centres(self) -> Values:
        """Distance of the cells' middles along the passage, in m."""
        return 0.5 * (self.m[1:] + self.m[:-1])

    @property
    def centre_radius(self) -> Values:
        """Of the cells' middles from the axis, in m."""
        return 0.5 * (self.radius[1:] + self.radius[:-1])

    @property
    def volume(self) -> Values:
        """Of the cells, in m3."""
        return 0.5 * (self.area[1:] + self.area[:-1]) * jnp.diff(self.m)


class Inlet(eqx.Module):
    """Gas that comes from a plenum at rest, with swirl.

    **Raises:** `InputError` for a total pressure or temperature that is not positive, or a tangent that is not finite.
    """

    total_pressure: Values
    """Pa absolute; one number, or one a time in `unsteady`."""
    total_temperature: Values
    """K."""
    tangent: Values
    """Of the angle from the meridional direction at which the gas enters, `V_u / V_m`."""

    def __check_init__(self) -> None:
        for name, unit in (("total_pressure", "pressure in Pa absolute"), ("total_temperature", "temperature in K")):
            require_positive(f"inlet.{name}", getattr(self, name), unit, "correct it")
        require_finite("inlet.tangent", self.tangent, "tangent of an angle", "correct it")

    def density(self, gas: Gas) -> Values:
        """In the plenum, in kg/m3."""
        return self.total_pressure / (gas.constant * self.total_temperature)


def _check_values(name: str, array: Float[np.ndarray, " values"]) -> None:
    if name == "m":
        wrong = ~(np.diff(array) > 0)
    elif name in ("radius", "area", "length"):
        wrong = ~(array > 0)
    else:
        wrong = (array < 0) if name == "friction" else np.zeros(array.shape, bool)
    wrong = np.append(wrong, False)[: array.size] | ~np.isfinite(array)
    if np.any(wrong):
        place = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"passage.{name} must be {NAMES[name]}, but entry {place} is {array[place]:g}; correct it", name
        )
