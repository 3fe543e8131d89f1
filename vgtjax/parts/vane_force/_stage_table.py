"""Steady solutions of a turbine stage over total pressure and crank angle, and a vane force that is read off them."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float

from ..._kept import keep_compiled
from ..._types import Scalar, Values
from ...traces import Drive
from ...turbine import CELLS, States, first_guess
from .._tabulated import AbstractTable, Rows
from .._vanes import Crank, Vanes
from ._base import AbstractStatelessVaneForce
from ._stage import CRANK_RANGE, HIGHEST_PRESSURE, Stage, flow_at, no_steady_flow

PRESSURES, ANGLES = 25, 25
"""Knots of the table, from the outlet's pressure, where nothing flows: linear between them, the force is within 0.03 N
of 47."""

ForceTable = Float[Array, "quantity pressures angles"]
"""Rod force in N and mass flow in kg/s over total pressure and crank angle."""
Knots = Float[Array, "pressures angles"]
"""One of the two."""
ALL = np.ones(PRESSURES, bool)
"""Rows of a whole table."""
ROUNDED = 1e-3
"""Of the first interval of pressures; a mass flow is linear below it, so that its slope is finite where none flows."""
MARGIN = 1e-3
"""Of an interval between two pressures, for rounding of what is read there."""


class StageTable(AbstractStatelessVaneForce, AbstractTable):
    """Rod force read off a table over total pressure and crank angle; linear between its knots, held beyond them, zero
    at or below the outlet's pressure. No state.

    NaN are points at which no steady flow was found, infinite those that it has no business to be read at.
    """

    forces: Knots
    flows: Knots
    crank: Crank
    total_temperature: Scalar
    ambient_pressure: Scalar
    outlet_pressure: Scalar

    def read(self, values: Knots, total_pressure: Values, crank_angle: Values) -> Values:
        """Value of one of its tables at Pa absolute and deg."""
        low, high = CRANK_RANGE
        row, across = _interval(_share(total_pressure, self.outlet_pressure), PRESSURES)
        column, along = _interval((crank_angle - low) / (high - low), ANGLES)

        def at(row: Array) -> Values:
            # A look-up: hats over all knots, as the maps with their few have them, take the march twice as long. One
            # number at a time, as a slice of four costs lanes a quarter of their time.
            here, next_to_it = (values.at[row, column + side].get(mode="clip") for side in (0, 1))
            return here + (next_to_it - here) * along

        below, above = at(row), at(row + 1)
        return below + (above - below) * across

    def lost(self) -> Bool[Array, ""]:
        """See the base class."""
        return jnp.any(jnp.isnan(self.forces))

    def mass_flow(self, total_pressure: Values, crank_angle: Values) -> Values:
        """In kg/s at Pa absolute and deg, of gas at `total_temperature`.

        Below the first pressure of the table it goes with the root of the pressure difference, as through an orifice.
        """
        passed = jnp.clip((PRESSURES - 1) * _share(total_pressure, self.outlet_pressure), 0.0, 1.0)
        beyond_linear = jnp.sqrt((1 + ROUNDED) / (passed + ROUNDED))
        return beyond_linear * self.read(self.flows, total_pressure, crank_angle)

    def __call__(self, vanes: Vanes, velocity: Values, state: None) -> tuple[Values, None]:
        """Force in N, the same in both directions: it follows the pressure within a tenth of a millisecond."""
        pressure = vanes.ambient(self.ambient_pressure) + vanes.turbine_pressure
        return self.read(self.forces, pressure, self.crank.angle(vanes.opening)), None


def rows_along(stage: Stage, ambient_pressure: Scalar, drives: Sequence[Drive]) -> Rows:
    """Which pressures of the table are read along drives. Ambient in Pa absolute."""
    crossed = jnp.zeros(PRESSURES + 1, int)
    for drive in drives:
        ramp = drive.turbine
        ambient = ambient_pressure + drive.ambient_shift
        ends = [ambient + pressure for pressure in (ramp.start, ramp.start + ramp.rate * drive.duration)]
        at = (PRESSURES - 1) * _share(jnp.stack(jnp.broadcast_arrays(*ends)), stage.outlet_pressure)
        first, last = jnp.floor(jnp.min(at, axis=0) - MARGIN), jnp.floor(jnp.max(at, axis=0) + MARGIN)
        first, last = (jnp.clip(row, 0, PRESSURES - 2).astype(int).ravel() for row in (first, last))
        # Between its rows each interval counts one, and reads the row behind them as well.
        crossed = crossed.at[first].add(1).at[last + 2].add(-1)
    return jnp.cumsum(crossed)[:-1] > 0


@keep_compiled
def solve_table(
    stage: Stage, rows: Rows = ALL, cells: int = CELLS
) -> tuple[ForceTable, Bool[Array, "pressures angles"]]:
    """Rod force and mass flow at the knots of some pressures or of all, and where a steady state was found; zero at the
    outlet's pressure."""
    outlet = stage.outlet_pressure
    pressures = outlet + (HIGHEST_PRESSURE - outlet) * jnp.linspace(0.0, 1.0, PRESSURES, dtype=outlet.dtype)[1:]

    def column(angle: Array) -> tuple[Array, Array]:
        # Each pressure is searched from the flow at the one below.
        def rising(near: States, at: tuple[Array, Array]) -> tuple[States, tuple[Array, Array]]:
            return jax.lax.cond(at[1], solve, leave, near, at[0])

        def solve(near: States, pressure: Array) -> tuple[States, tuple[Array, Array]]:
            flow, values, states = flow_at(stage, pressure, angle, cells, near)
            return jnp.where(flow.converged, states, near), (values, flow.converged)

        def leave(near: States, pressure: Array) -> tuple[States, tuple[Array, Array]]:
            return near, (jnp.zeros(2, near.dtype), jnp.asarray(False))

        guess = first_guess(*stage.passage(pressures[0], angle, cells), stage.gas)
        return jax.lax.scan(rising, jax.lax.stop_gradient(guess), (pressures, jnp.asarray(rows)[1:]))[1]

    values, found = jax.lax.map(column, jnp.linspace(*CRANK_RANGE, ANGLES, dtype=outlet.dtype))
    table, found = jnp.transpose(values, (2, 1, 0)), found.T
    still = jnp.zeros_like(table[:, :1])
    return jnp.concatenate([still, table], axis=1), jnp.concatenate([jnp.ones_like(found[:1]), found])


@jax.custom_jvp
def checked_table(stage: Stage, rows: Rows) -> ForceTable:
    """A table of some pressures; NaN at points that failed, and everywhere of a stage that does not work, so that a
    simulation that comes there fails too. Infinite at other pressures.

    In reverse mode its derivatives are those of forward mode, one column of the table for each value that moves: what
    pulls a cotangent back through searches inside of searches takes minutes to compile.
    """
    return _checked(stage, rows)


def _checked(stage: Stage, rows: Rows) -> ForceTable:
    """See `checked_table`."""
    table, found = solve_table(stage, rows)
    asked = jnp.asarray(rows)[:, None] | found
    return jnp.where(asked, jnp.where(found & stage.works(), table, jnp.nan), jnp.inf)


def _move_table(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[ForceTable, ForceTable]:
    stage, rows = primals
    leaves, shape = jax.tree.flatten(stage)
    moved = {
        place: tangent
        for place, tangent in enumerate(jax.tree.leaves(tangents[0], is_leaf=_stands))
        if not _stands(tangent)
    }

    def table(values: Array) -> ForceTable:
        there = dict(zip(moved, values, strict=True))
        return _checked(jax.tree.unflatten(shape, [there.get(i, leaf) for i, leaf in enumerate(leaves)]), rows)

    at = jnp.stack([leaves[place] for place in moved])
    columns = jax.vmap(lambda along: jax.jvp(table, (at,), (along,)), out_axes=(None, 0))
    made, by_value = columns(jnp.eye(len(moved), dtype=at.dtype))
    # In proportion to the tangents, which can be turned round; the columns hang on values alone.
    return made, jnp.tensordot(jnp.stack(list(moved.values())), by_value, 1)


checked_table.defjvp(_move_table, symbolic_zeros=True)


@jax.custom_jvp
def current_table(stage: Stage, rows: Rows, made_of: tuple[Array, ...], made: ForceTable) -> ForceTable:
    """The table that was made of a stage's values, with derivatives by steady solutions at some pressures; infinite if
    they have moved."""
    pairs = zip(jax.tree.leaves(stage), made_of, strict=True)
    same = jnp.all(jnp.stack([jnp.all(a == b) for a, b in pairs]))
    return jnp.where(same, made, jnp.inf)


def _differentiate(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Any]:
    stage, rows, made_of, made = primals
    if all(_stands(leaf) for leaf in jax.tree.leaves(tangents[0], is_leaf=_stands)):
        table = current_table(stage, rows, made_of, made)
        return table, jnp.zeros_like(table)
    return _move_table((stage, rows), tangents[:2])


current_table.defjvp(_differentiate, symbolic_zeros=True)


def _stands(tangent: Any) -> bool:
    """Whether a value does not move at all."""
    return isinstance(tangent, SymbolicZero)


def make_table(stage: Stage) -> ForceTable:
    """The table of a stage; that of one that was met before is remembered.

    **Raises:** `InputError` for a geometry that does not work; `SimulationError` for a point that is not found.
    """
    leaves, shape = jax.tree.flatten(stage)
    return _remembered(tuple(float(leaf) for leaf in leaves), jnp.result_type(*leaves).name, shape)


@functools.lru_cache(maxsize=16)
def _remembered(values: tuple[float, ...], dtype: str, shape: Any) -> ForceTable:
    stage: Stage = jax.tree.unflatten(shape, [jnp.asarray(value, dtype) for value in values])
    stage.require_working()
    table, found = solve_table(stage, jnp.asarray(ALL))
    if not np.all(found):
        row, column = np.argwhere(~np.asarray(found))[0]
        outlet = float(stage.outlet_pressure)
        pressure = outlet + (HIGHEST_PRESSURE - outlet) * row / (PRESSURES - 1)
        raise no_steady_flow(stage, pressure, np.linspace(*CRANK_RANGE, ANGLES)[column])
    return table


def _share(total_pressure: Values, outlet_pressure: Scalar) -> Values:
    """Of the table's pressures that a total pressure in Pa absolute has passed."""
    return (total_pressure - outlet_pressure) / (HIGHEST_PRESSURE - outlet_pressure)


def _interval(share: Values, knots: int) -> tuple[Array, Values]:
    """Which interval between evenly spaced knots a share of their range is in, and how far; held at the ends."""
    at = jnp.clip(share, 0.0, 1.0) * (knots - 1)
    first = jnp.clip(jnp.floor(at), 0, knots - 2)
    return first.astype(int), at - first
