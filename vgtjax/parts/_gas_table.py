"""Tables over turbine pressure and crank angle (section 3.4.2)."""

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from ._air import Scalar
from ._tables import bilinear
from ._vanes import Crank, Vanes

Table = Float[Array, " knots"]
"""A row of crank angles for every turbine pressure, one row after the other."""


class Knots(eqx.Module):
    """Where tables have their values: increasing turbine pressures in Pa gauge above zero, increasing angles in deg.

    Without gas every table is zero; it is linear from there to its first row, linear between knots, held beyond them.
    """

    turbine_pressure: Float[Array, " pressures"]
    crank_angle: Float[Array, " angles"]
    crank: Crank

    def read(self, table: Table, vanes: Vanes) -> Scalar:
        """Value of a table for vanes under gas."""
        rows = table.reshape(-1, self.crank_angle.shape[-1])
        return bilinear(
            jnp.concatenate([jnp.zeros_like(self.turbine_pressure[:1]), self.turbine_pressure]),
            self.crank_angle,
            jnp.concatenate([jnp.zeros_like(rows[:1]), rows]),
            vanes.turbine_pressure,
            self.crank.angle(vanes.opening),
        )

    def reread(self, table: Table, other: "Knots") -> Float[np.ndarray, " others"]:
        """The same table at other knots."""
        pressures, angles = np.meshgrid(other.turbine_pressure, other.crank_angle, indexing="ij")
        vanes = Vanes(self.crank.opening(angles.ravel()), pressures.ravel())
        return np.asarray(jax.vmap(lambda at: self.read(table, at))(vanes))

    def check(self, owner: str, tables: dict[str, Table]) -> None:
        """Whether knots increase and tables have a value for each; values under tracing pass.

        **Raises:** `InputError` otherwise.
        """
        if isinstance(self.turbine_pressure, jax.core.Tracer) or isinstance(self.crank_angle, jax.core.Tracer):
            return
        above_zero = np.concatenate([[0.0], self.turbine_pressure])
        _check_increasing(f"{owner}.turbine_pressure", above_zero, "Pa gauge from above zero")
        _check_increasing(f"{owner}.crank_angle", np.asarray(self.crank_angle), "deg")
        pressures, angles = self.turbine_pressure.size, self.crank_angle.size
        for name, table in tables.items():
            if table.size != pressures * angles:
                raise InputError(
                    f"{owner}.{name} needs {pressures * angles} numbers, one for each turbine pressure and crank "
                    f"angle, but it has {table.size}; give {pressures} rows of {angles}"
                )


def _check_increasing(name: str, knots: Float[np.ndarray, " knots"], unit: str) -> None:
    if len(knots) < 2 or not np.all(np.diff(knots) > 0):
        raise InputError(
            f"{name} must be at least two knots that increase, in {unit}, but it is {[float(k) for k in knots]}; sort "
            "them and remove repeated ones"
        )
