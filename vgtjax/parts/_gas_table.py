"""Tables over turbine pressure and crank angle (section 3.4.2)."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError, is_traced
from .._types import Knots, Values
from ._vanes import HasCrank, Vanes

OPERATING_POINTS = (0.0, 1.5e5, 3.0e5)
"""Pa gauge at the turbine's inlet; those of the thesis (sections 3.4.2 and 4.2)."""

Table = Float[Array, " knots"]
"""A row of crank angles for every turbine pressure, one row after the other."""
AXES = ("turbine_pressure", "crank_angle")
"""Of such a table, as [`parameter`][vgtjax.parameters.parameter] declares it."""
GasTables = TypeVar("GasTables", bound="AbstractGasTables")


class AbstractGasTables(HasCrank):
    """A component with tables over turbine pressure and crank angle.

    Without gas every table is zero; it is linear from there to its first row, linear between knots, held beyond them.

    **Raises:** `InputError` for knots that don't increase, or a table that has not one value for each.
    """

    place: eqx.AbstractClassVar[str]
    turbine_pressure: eqx.AbstractVar[Float[Array, " pressures"]]
    """Knots in Pa gauge, increasing, above zero."""
    crank_angle: eqx.AbstractVar[Float[Array, " angles"]]
    """Knots in deg, increasing."""

    @property
    def tables(self) -> dict[str, Table]:
        """Tables by the names of their fields: parameters with the axes `AXES`."""
        rows = {field.name: field.metadata.get("parameter") for field in dataclasses.fields(self)}
        return {name: getattr(self, name) for name, row in rows.items() if row is not None and row.axes == AXES}

    def __check_init__(self) -> None:
        if is_traced(self.turbine_pressure, self.crank_angle):
            return
        owner = self.place
        above_zero = np.concatenate([[0.0], self.turbine_pressure])
        require_knots(f"{owner}.turbine_pressure", above_zero, "Pa gauge from above zero")
        require_knots(f"{owner}.crank_angle", np.asarray(self.crank_angle), "deg")
        pressures, angles = self.turbine_pressure.size, self.crank_angle.size
        for name, table in self.tables.items():
            if table.size != pressures * angles:
                raise InputError(
                    f"{owner}.{name} needs {pressures * angles} numbers, one for each turbine pressure and crank "
                    f"angle, but it has {table.size}; give {pressures} rows of {angles}",
                    "values",
                )

    def read(self, table: Table, vanes: Vanes) -> Values:
        """Value of one of its tables for vanes under gas."""
        rows = table.reshape(-1, self.crank_angle.shape[-1])
        return bilinear(
            jnp.concatenate([jnp.zeros_like(self.turbine_pressure[:1]), self.turbine_pressure]),
            self.crank_angle,
            jnp.concatenate([jnp.zeros_like(rows[:1]), rows]),
            vanes.turbine_pressure,
            self.crank.angle(vanes.opening),
        )

    def on_knots(
        self: GasTables,
        turbine_pressure: Sequence[float] | Knots | None = None,
        crank_angle: Sequence[float] | Knots | None = None,
    ) -> GasTables:
        """The same component, its tables read at other knots (Pa gauge, deg); those that are not given stay."""
        pressure = self.turbine_pressure if turbine_pressure is None else jnp.asarray(turbine_pressure, float)
        angle = self.crank_angle if crank_angle is None else jnp.asarray(crank_angle, float)
        tables: dict[str, Any] = _read_at(self, pressure, angle)
        return dataclasses.replace(self, turbine_pressure=pressure, crank_angle=angle, **tables)


@eqx.filter_jit
def _read_at(component: AbstractGasTables, pressure: Knots, angle: Knots) -> dict[str, Table]:
    """All tables of a component, read at other knots; compiled once for all units of a fleet."""
    pressures, angles = (each.ravel() for each in jnp.meshgrid(pressure, angle, indexing="ij"))
    vanes = Vanes(component.crank.opening(angles), pressures)
    return {
        name: jax.vmap(lambda at, table=table: component.read(table, at))(vanes)
        for name, table in component.tables.items()
    }


def require_knots(name: str, knots: Float[np.ndarray, " knots"], unit: str) -> None:
    """**Raises:** `InputError` for knots of a table that are not two or more and increase."""
    if len(knots) < 2 or not np.all(np.diff(knots) > 0):
        raise InputError(
            f"{name} must be at least two knots that increase, in {unit}, but it is {[float(k) for k in knots]}; sort "
            "them and remove repeated ones",
            "values",
        )


def _ramps(knots: Knots, at: Values) -> list[Values]:
    """How far `at` has crossed each interval of increasing `knots`, from 0 to 1."""
    count = knots.shape[0]
    return [jnp.clip((at - knots[k]) / (knots[k + 1] - knots[k]), 0.0, 1.0) for k in range(count - 1)]


def _along(values: Sequence[Values], ramps: Sequence[Values]) -> Values:
    total = values[0]
    for low, high, ramp in zip(values[:-1], values[1:], ramps, strict=True):
        total = total + (high - low) * ramp
    return total


def bilinear(
    rows: Knots, columns: Knots, values: Float[Array | np.ndarray, "rows columns"], row: Values, column: Values
) -> Values:
    """Value of a table at `(row, column)`, linear between its increasing knots and held beyond them.

    Continuous, with kinks at the knots.
    """
    # A sum over intervals instead of a look-up: tables are small, and a gather inside a march is slow.
    over_columns = _ramps(columns, column)
    by_row = [_along([values[i, j] for j in range(values.shape[1])], over_columns) for i in range(values.shape[0])]
    return _along(by_row, _ramps(rows, row))
