"""Flow over plunger position and pressure as a table [5.1]."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._errors import InputError, is_traced
from ..._types import Scalar, Values
from ...parameters import parameter
from ...traces import STANDARD_ATMOSPHERE
from .._gas_table import require_knots
from ._base import AbstractLiftMap


class LiftTable(AbstractLiftMap):
    """Table over plunger position and chamber pressure, linear between its knots and held beyond them [5.1].

    The default is a table without any flow: [`fit_flow_map`][] makes one.
    """

    position: Float[Array, " positions"] = parameter(
        (-1e-3, 1e-3), symbol="x_p", unit="m", source="fitted", positive=False, held=True
    )
    """Knots, increasing."""
    pressure: Float[Array, " pressures"] = parameter(
        (2.0e4, STANDARD_ATMOSPHERE), symbol="p_act", unit="Pa", source="fitted", held=True
    )
    """Knots, increasing."""
    flow: Float[Array, " knots"] = parameter(
        (0.0,) * 4,
        symbol="lambda",
        unit="kg/s",
        source="fitted",
        positive=False,
        held=True,
        axes=("position", "pressure"),
    )
    """A row of pressures for every position, one row after the other."""
    ambient: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_map", unit="Pa", source="B.2", held=True)

    def __check_init__(self) -> None:
        if is_traced(self.position, self.pressure, self.flow):
            return
        require_knots("position", np.asarray(self.position), "m")
        require_knots("pressure", np.asarray(self.pressure), "Pa")
        rows, columns = len(self.position), len(self.pressure)
        if self.flow.size != rows * columns:
            raise InputError(
                f"a table needs {rows * columns} flows, one for each position and pressure, but it has "
                f"{self.flow.size}; give {rows} rows of {columns}"
            )

    def __call__(self, position: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s."""
        gauged = pressure if ambient is None else pressure - (ambient - self.ambient)
        return jnp.vectorize(self._look_up)(position, gauged)

    def _look_up(self, position: Values, pressure: Values) -> Values:
        # Gathered, unlike `bilinear`, whose sum over intervals compiles for ten seconds at this size and runs a
        # batch sixteen times slower.
        row, down = _place(self.position, position)
        column, across = _place(self.pressure, pressure)
        width = self.pressure.shape[-1]
        corner = row * width + column
        flow = self.flow
        above = flow[corner] + across * (flow[corner + 1] - flow[corner])
        below = flow[corner + width] + across * (flow[corner + width + 1] - flow[corner + width])
        # As a difference, so that two equal rows (a saturated orifice) have a slope of exactly zero.
        return above + down * (below - above)


def _place(knots: Float[Array, " knots"], at: Values) -> tuple[Int[Array, ""], Values]:
    """The interval between knots where a value lies, held within the outer ones, and how far across it."""
    within = jnp.clip(at, knots[0], knots[-1])
    index = jnp.clip(jnp.sum(within >= knots) - 1, 0, knots.shape[-1] - 2)
    low, high = knots[index], knots[index + 1]
    return index, (within - low) / (high - low)
