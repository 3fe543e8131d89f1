"""Vane force from first principles: one-dimensional flow through the variable nozzle (section 3.5)."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..._errors import is_traced, require_finite, require_positive
from ..._types import Scalar, Values
from ...parameters import Part, as_float_array, parameter
from ...traces import STANDARD_ATMOSPHERE, Drive
from ...turbine import CELLS, Gas, Nozzle, PassageFlow
from .._tabulated import AbstractTabulated, Rows
from .._vanes import Crank, HasCrank, Vanes
from ._base import AbstractStatelessVaneForce
from ._stage import (
    OUTLET_PRESSURE,
    SPEED_RATIO,
    TOTAL_TEMPERATURE,
    WHEEL_SPEED,
    Linkage,
    Stage,
    flow_at,
    no_steady_flow,
    one_of_both,
)
from ._stage_table import ALL, ForceTable, StageTable, checked_table, current_table, make_table, rows_along


class Turbine(AbstractStatelessVaneForce, AbstractTabulated, HasCrank):
    """Force of one-dimensional flow through the nozzle on its vanes, at the rod (3.21-3.72, corrected; section 3.5).

    Made of steady solutions, when it is built, as a table over total pressure and crank angle; the force of an unsteady
    flow follows within 0.1 ms. With other parameters from [`replace_parameters`][] the table is made anew, also inside
    of `jit`, and derivatives with respect to all of them are exact. A simulation with parameters that were put in by
    other means inside of `jit` fails rather than read a table of old ones.

    No measured vane force validates it: sizes and the state of the gas are assumed.

    The wheel turns by a `speed_ratio`, 0.6 unless another is given, or at a `wheel_speed`.

    **Raises:** `InputError` for a geometry that does not work, such as vanes that close their throat, or for both a
    ratio and a speed of the wheel; `SimulationError` that names the point, if a steady state is not found.
    """

    equations: ClassVar[str] = "3.21-3.72"
    caveat: ClassVar[str] = (
        "by flow through a nozzle whose sizes are assumed, as is the state of the gas, and no measured vane force "
        "validates it"
    )
    nozzle: Nozzle = eqx.field(default_factory=Nozzle)
    linkage: Linkage = eqx.field(default_factory=Linkage)
    gas: Gas = eqx.field(default_factory=Gas)
    total_temperature: Scalar = parameter(TOTAL_TEMPERATURE, symbol="T_03", unit="K", source="assumed", held=True)
    """Of the gas before the turbine."""
    outlet_pressure: Scalar = parameter(OUTLET_PRESSURE, symbol="p_4", unit="Pa", source="assumed", held=True)
    """Pa absolute, behind the turbine."""
    speed_ratio: Scalar | None = parameter(
        SPEED_RATIO, symbol="nu", unit="-", source="assumed", held=True, optional=True
    )
    """Speed of the wheel's blades over the spouting velocity, whatever the pressure; with no `wheel_speed` only."""
    wheel_speed: Scalar | None = parameter(
        WHEEL_SPEED, symbol="Omega", unit="rad/s", source="assumed", held=True, optional=True
    )
    """Of a wheel that turns at one speed whatever the pressure, in place of the ratio."""
    ambient_pressure: Scalar = parameter(STANDARD_ATMOSPHERE, symbol="p_atm", unit="Pa", source="B.2", held=True)
    """Pa absolute, from which turbine pressure counts on a day with the standard atmosphere."""
    crank: Crank = eqx.field(default_factory=Crank)
    _made: tuple[tuple[Array, ...], ForceTable] | None = None

    def __init__(
        self,
        nozzle: Nozzle | None = None,
        linkage: Linkage | None = None,
        gas: Gas | None = None,
        total_temperature: float | Scalar = TOTAL_TEMPERATURE,
        outlet_pressure: float | Scalar = OUTLET_PRESSURE,
        speed_ratio: float | Scalar | None = None,
        ambient_pressure: float | Scalar = STANDARD_ATMOSPHERE,
        crank: Crank | None = None,
        wheel_speed: float | Scalar | None = None,
    ):
        self.nozzle, self.linkage = nozzle or Nozzle(), linkage or Linkage()
        self.gas, self.crank = gas or Gas(), crank or Crank()
        self.total_temperature, self.outlet_pressure = (
            as_float_array(total_temperature),
            as_float_array(outlet_pressure),
        )
        self.ambient_pressure = as_float_array(ambient_pressure)
        self.speed_ratio, self.wheel_speed = one_of_both(speed_ratio, wheel_speed)
        Part.__check_init__(self)  # before a table is made of it
        self._made = _make(self.stage)

    @property
    def stage(self) -> Stage:
        """All that the flow depends on."""
        return Stage(
            self.nozzle,
            self.linkage,
            self.crank,
            self.gas,
            self.total_temperature,
            self.outlet_pressure,
            self.speed_ratio,
            self.wheel_speed,
        )

    def renewed(self) -> "Turbine":
        """See the base class."""
        return eqx.tree_at(lambda each: each._made, self, _make(self.stage), is_leaf=lambda node: node is self._made)

    def table(self, rows: Rows | None = None) -> ForceTable:
        """See the base class; NaN where no steady state was found, and in all of a nozzle's whose geometry does not
        work, so that a simulation that comes there fails."""
        rows = jnp.asarray(ALL if rows is None else rows)
        if self._made is None:
            return checked_table(self.stage, rows)
        return current_table(self.stage, rows, *self._made)

    def rows(self, *drives: Drive) -> Rows:
        """See the base class; a row is a total pressure."""
        return rows_along(self.stage, self.ambient_pressure, drives)

    def with_table(self, table: ForceTable) -> StageTable:
        """See the base class."""
        around = self.total_temperature, self.ambient_pressure, self.outlet_pressure
        forces, flows = table
        return StageTable(forces, flows, self.crank, *around)

    def flow(self, total_pressure: Scalar, crank_angle: Scalar, cells: int = CELLS) -> PassageFlow:
        """Steady flow through the nozzle at Pa absolute and deg; see `converged`.

        **Raises:** `InputError` for a pressure that is not positive, or an angle at which the nozzle does not work.
        """
        pressure, angle = self._checked(total_pressure, crank_angle)
        return flow_at(self.stage, pressure, angle, cells)[0]

    def rod_force(self, total_pressure: Scalar, crank_angle: Scalar) -> Values:
        """Force in N against +x by a steady solution, not by the table; Pa absolute and deg. Zero at or below the
        outlet's pressure.

        **Raises:** as `flow`, and `SimulationError` where none is found; inside of `jit` the force is NaN.
        """
        pressure, angle = self._checked(total_pressure, crank_angle)
        flowing = pressure > self.outlet_pressure
        # Where nothing flows another state is solved for, whose force is not taken.
        flow, values, _ = flow_at(self.stage, jnp.where(flowing, pressure, 2 * self.outlet_pressure), angle)
        if not is_traced(flow.converged) and not bool(flow.converged):
            raise no_steady_flow(self.stage, float(pressure), float(angle))
        return jnp.where(flow.converged, jnp.where(flowing, values[0], 0.0), jnp.nan)

    def _checked(self, total_pressure: Scalar, crank_angle: Scalar) -> tuple[Array, Array]:
        """Both as arrays.

        **Raises:** as `flow`.
        """
        require_positive("total_pressure", total_pressure, "pressure in Pa absolute", "correct it")
        require_finite("crank_angle", crank_angle, "angle in deg", "correct it")
        self.nozzle.require_range(self.stage.vane_angle(crank_angle))
        return as_float_array(total_pressure), as_float_array(crank_angle)

    def mass_flow(self, total_pressure: Values, crank_angle: Values) -> Values:
        """In kg/s at Pa absolute and deg, read off the table, of gas at `total_temperature`."""
        return self.with_table(self.table()).mass_flow(total_pressure, crank_angle)

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Force in N, the same in both directions; see [`StageTable`][]."""
        return self.with_table(self.table())(vanes, velocity, state)


def _make(stage: Stage) -> tuple[tuple[Array, ...], ForceTable] | None:
    """The values of a stage and its table, or nothing while they are traced."""
    return None if is_traced(stage) else (tuple(jax.tree.leaves(stage)), make_table(stage))
