"""The periodic cycle of an engine and its manifold, as the root of one firing interval."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .._errors import InputError
from ..parts import tabulated
from ..simulation import RESULTS, blame, check_result, choose
from ._blow_down import Cylinders, Gas, Geometry, State, fire, geometry, manifold_pressure, step
from ._engine import Engine
from ._operating_point import OperatingPoint
from ._valve import CYCLE

GRID = 0.5
"""deg from one value of a cycle to the next."""
SUBSTEPS = 4
"""Steps from one value to the next, unless asked for more."""
RUN_IN = 8
"""Firing intervals that are run out before Newton's method takes over, so that it begins near enough."""
NEWTON_STEPS = 32

Cycle = Float[Array, " crank"]


class Pulsation(NamedTuple):
    """One cycle in the manifold, which every further one repeats, from the firing TDC of the first cylinder."""

    crank: Cycle
    """deg, 0 to 719.5"""
    p_trb: Cycle
    """Pressure at the turbine's inlet in Pa absolute."""
    temperature: Cycle
    """K"""
    mass_flow: Cycle
    """Into the turbine in kg/s."""


def pulsation(engine: Engine, point: OperatingPoint, *, substeps: int = SUBSTEPS) -> Pulsation:
    """The pressure that an engine makes at the inlet of its turbine, over a cycle.

    Can be jitted, vmapped, and differentiated in both modes with respect to every floating leaf of both arguments; the
    derivatives are those of the periodic cycle itself, by the implicit function theorem.

    **Arguments:** `substeps`: steps of the integration in 0.5 deg; an engine slower than 400 rpm needs more.

    **Returns:** crank angle in deg (720 deg in steps of 0.5), pressure in Pa absolute, temperature in K and mass flow
    into the turbine in kg/s.

    **Raises:** `InputError` when the firing interval is no multiple of 0.5 deg; `SimulationError` when no cycle that
    repeats itself is found (inside of `jit` and `vmap`, where one lane raises for all, a `RuntimeError` of equinox; see
    [`steady_cycle`][]).
    """
    cycle, result = steady_cycle(engine, point, substeps=substeps)
    return check_result(cycle, result, "the cycle of the engine")


def steady_cycle(engine: Engine, point: OperatingPoint, *, substeps: int = SUBSTEPS) -> tuple[Pulsation, RESULTS]:
    """As [`pulsation`][], but says how the search ended in place of raising, one answer a lane."""
    if substeps < 1:
        raise InputError(f"0.5 deg must have one step or more, but {substeps} are asked for; use e.g. {SUBSTEPS}")
    if int(CYCLE / GRID) % engine.cylinders:
        raise InputError(
            f"cylinders must fire every so many times {GRID:g} deg, but {engine.cylinders} of them do so every "
            f"{engine.interval:g} deg; choose another firing_order"
        )
    return _solve(engine, point, substeps)


@eqx.filter_jit
def _solve(engine: Engine, point: OperatingPoint, substeps: int) -> tuple[Pulsation, RESULTS]:
    point = tabulated(point)
    solver: optx.Newton = optx.Newton(*[float(jnp.finfo(engine.bore.dtype).eps) ** 0.75] * 2)
    guess = jax.tree.map(jnp.log, _run_in(*_constant((engine, point)), substeps))
    found: optx.Solution = optx.root_find(
        _misses, solver, guess, (engine, point, substeps), max_steps=NEWTON_STEPS, throw=False
    )
    cycle = _cycle(engine, point, jax.tree.map(jnp.exp, found.value), substeps)
    good = (found.result == optx.RESULTS.successful) & jnp.all(jnp.isfinite(jnp.stack(cycle)))
    return cycle, blame(point, choose(good, RESULTS.successful, RESULTS.not_periodic))


def _constant(tree: tuple[Engine, OperatingPoint]) -> tuple[Engine, OperatingPoint]:
    """The same, which nothing is differentiated with respect to: a root does not depend on where its search begins."""
    return jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, tree)


def _misses(logarithms: State, args: tuple[Engine, OperatingPoint, int]) -> State:
    """By how much the state after a firing interval differs from the one before, in logarithms: all are positive."""
    engine, point, substeps = args
    begin = jax.tree.map(jnp.exp, logarithms)
    after = fire(_interval(engine, point, begin, substeps)[0], point)
    return jax.tree.map(lambda y, log: jnp.log(y) - log, after, logarithms)


def _run_in(engine: Engine, point: OperatingPoint, substeps: int) -> State:
    """The state after some firing intervals that began with fresh charges and a manifold at the outlet's pressure."""
    ones = jnp.ones(engine.cylinders, engine.bore.dtype)
    heat = point.outlet_pressure * engine.manifold_volume / engine.gas.gas_constant
    manifold = Gas(heat / point.opening_temperature, heat)
    state = State(Cylinders(ones * point.trapped_mass, ones * point.opening_temperature), manifold)

    def interval(state: State, _: None) -> tuple[State, None]:
        return fire(_interval(engine, point, state, substeps)[0], point), None

    return jax.lax.scan(interval, state, length=RUN_IN)[0]


def _interval(engine: Engine, point: OperatingPoint, state: State, substeps: int) -> tuple[State, State]:
    """The state at the end of a firing interval, and the states before every step of it."""
    turn = GRID / substeps
    begins = np.arange(round(engine.interval / turn)) * turn
    angles = jnp.asarray(begins[:, None] + turn * np.array([[0, 0.5, 1.0]]), engine.bore.dtype)
    stages = jax.vmap(jax.vmap(lambda angle: geometry(engine, angle)))(angles)

    def advance(state: State, stages: Geometry) -> tuple[State, State]:
        return step(engine, point, state, stages, turn), state

    return jax.lax.scan(advance, state, stages)


def _cycle(engine: Engine, point: OperatingPoint, begin: State, substeps: int) -> Pulsation:
    """What the manifold does over a whole cycle: the same in every firing interval."""
    states = _interval(engine, point, begin, substeps)[1].manifold
    manifold = jax.tree.map(lambda leaf: jnp.tile(leaf[::substeps], engine.cylinders), states)
    pressure, temperature = manifold_pressure(engine, manifold), manifold.temperature
    leaving = jax.vmap(lambda p, t: point.leaving(engine.gas, p, t))(pressure, temperature)
    return Pulsation(jnp.arange(0.0, CYCLE, GRID, leaving.dtype), pressure, temperature, leaving)
