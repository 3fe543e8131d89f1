"""Steady flow: pseudo-transient Newton steps to the balance of all cells [3.68-3.70], derivatives by the implicit
function theorem."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._types import Scalar, Values
from ._balance import Balance, balance_of
from ._blocks import band_of, solve_band
from ._gas import Gas
from ._passage import Inlet, Passage
from ._riemann import States, densities, pack, unpack

FIRST_CFL, GROWTH, CAREFUL_GROWTH = 5.0, (1.5, 10.0), (1.3, 1.6)
"""Length of the first step in transits of a cell by sound, and by what the next one is longer, at least and at most."""
HASTY_STEPS = 30
"""After which growth is careful, from the first length on: gas that is sonic all along a duct hardly says where."""
LONGEST_MOVE = 0.3
"""How far a step may go in any variable, in its usual size."""
MOST_STEPS = 120
EXACT, GOOD = 50.0, 0.7
"""Imbalance over what the largest area could pass at which steps end, in units of rounding, and the power of rounding
above which no flow is found: 1e-11 of double precision."""
PATIENCE = 3
"""Steps without a smaller imbalance, once it is good, after which it is rounding."""


class Flow(eqx.Module):
    """Flow through a passage, one value a cell unless said; with a leading axis of times from `march`."""

    m: Values
    """Distance along the passage, in m."""
    density: Values
    """kg/m3."""
    v_m: Values
    """Meridional velocity in m/s."""
    v_u: Values
    """Circumferential velocity in m/s, absolute frame."""
    pressure: Values
    """Pa absolute."""
    temperature: Values
    """K."""
    mass_flow: Values
    """kg/s; where the gas leaves."""
    power: Values
    """Power at the shaft in W that the gas gives away."""
    blade_force: Values
    """Circumferential force of the blades on the gas of each cell, in N."""
    converged: Bool[Array, "..."]
    """Whether all balances hold."""


def steady(passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas) -> Flow:
    """Steady flow through a passage, subsonic, choked or with a shock.

    Differentiable in both modes by the implicit function theorem. Where `converged` is false no other value means
    anything, nor does a derivative.

    **Arguments:** `outlet_pressure` in Pa absolute.
    """
    return steady_near(passage, inlet, outlet_pressure, gas)[0]


def steady_near(
    passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas, near: States | None = None
) -> tuple[Flow, States]:
    """`steady`, searched from the states of a flow nearby, and the states that it ends at, without derivatives."""
    balance = balance_of(passage, inlet, outlet_pressure, gas)
    start = first_guess(passage, inlet, gas) if near is None else near
    states, imbalance = _search(*jax.lax.stop_gradient((balance, start)))
    states = jax.lax.stop_gradient(states)
    # One more step, whose right side carries all derivatives.
    band = jax.lax.stop_gradient(band_of(jax.lax.stop_gradient(balance), states))
    moved = states - solve_band(band, balance(states))
    converged = jax.lax.stop_gradient(imbalance) < jnp.finfo(states.dtype).eps ** GOOD
    return flow_of(balance, jnp.where(converged, moved, states), converged), states


def flow_of(balance: Balance, states: States, converged: Bool[Array, "..."]) -> Flow:
    """What a state of all cells means."""
    passage, gas = balance.passage, balance.gas
    density, velocity, swirl, pressure = unpack(states)
    forces = balance.forces(states)
    moment = passage.volume * passage.centre_radius * (forces.blade_u + forces.friction_u)
    return Flow(
        passage.centres,
        density,
        velocity,
        swirl / passage.centre_radius,
        pressure,
        pressure / (gas.constant * density),
        balance.fluxes(states)[-1, 0] * passage.area[-1],
        -jnp.sum(passage.speed * moment),
        passage.volume * forces.blade_u,
        converged,
    )


def imbalance_of(balance: Balance, states: States) -> Values:
    """Largest imbalance of a cell over what gas at rest in the plenum would carry at its speed of sound."""
    return jnp.max(jnp.abs(balance(states)) / balance.usual[None])


def first_guess(passage: Passage, inlet: Inlet, gas: Gas) -> States:
    """A small flow that follows the blades, marched through the passage without loss."""
    radius = passage.centre_radius
    density = inlet.total_pressure / (gas.constant * inlet.total_temperature)
    area = passage.volume / jnp.diff(passage.m)
    cosine = jnp.where(passage.row > 0, 1 / jnp.sqrt(1 + passage.tangent**2), 1 / jnp.sqrt(1 + inlet.tangent**2))
    velocity = 0.2 * gas.sound_speed(inlet.total_temperature) * jnp.min(area * cosine) / area
    turned = radius * (velocity * passage.tangent + radius * passage.speed)

    def follow(carry: Any, cell: Any) -> tuple[Any, Any]:
        swirl, enthalpy = carry
        row, wanted, speed = cell
        onward = jnp.where(row > 0, wanted, swirl)
        after = onward, enthalpy + speed * (onward - swirl)
        return after, after

    at_rest = gas.heat_capacity * inlet.total_temperature
    entering = passage.radius[0] * velocity[0] * inlet.tangent
    _, (swirl, enthalpy) = jax.lax.scan(follow, (entering, at_rest), (passage.row, turned, passage.speed))
    kinetic = 0.5 * (velocity**2 + (swirl / radius) ** 2)
    ratio = jnp.clip((enthalpy - kinetic) / at_rest, 0.5, 2.0)
    expanded = gas.expanded_pressure(inlet.total_pressure, ratio)
    return pack(density * ratio ** (1 / (gas.gamma - 1)), velocity, swirl, expanded)


class _Search(eqx.Module):
    """Where the search stands; `best` are the states with the least imbalance so far."""

    states: States
    cfl: Values
    imbalance: Values
    best: States
    least: Values
    steps: Array
    waited: Array


def _search(balance: Balance, start: States) -> tuple[States, Values]:
    """States of the least imbalance, and that."""
    first = imbalance_of(balance, start)
    zero, rounding = jnp.zeros((), int), jnp.finfo(start.dtype).eps

    def unfinished(at: _Search) -> Array:
        stale = (at.waited >= PATIENCE) & (at.least < rounding**GOOD)
        return (at.least > EXACT * rounding) & ~stale & (at.steps < MOST_STEPS) & jnp.isfinite(at.imbalance)

    def onward(at: _Search) -> _Search:
        hasty = at.steps < HASTY_STEPS
        cfl = jnp.where(at.steps == HASTY_STEPS, FIRST_CFL, at.cfl)
        move = _step(balance, at.states, cfl) / balance.scale[None]
        states = at.states + jnp.clip(move, -LONGEST_MOVE, LONGEST_MOVE) * balance.scale[None]
        imbalance = imbalance_of(balance, states)
        least, most = (jnp.where(hasty, *each) for each in zip(GROWTH, CAREFUL_GROWTH, strict=True))
        growth = jnp.clip(at.imbalance / imbalance, least, most)
        better = imbalance < at.least
        best = jnp.where(better, states, at.best)
        waited = jnp.where(better, zero, at.waited + 1)
        return _Search(
            states, cfl * growth, imbalance, best, jnp.where(better, imbalance, at.least), at.steps + 1, waited
        )

    begin = _Search(start, jnp.full_like(first, FIRST_CFL), first, start, first, zero, zero)
    end = jax.lax.while_loop(unfinished, onward, begin)
    return end.best, end.least


def _step(balance: Balance, states: States, cfl: Values) -> States:
    """A step of implicit Euler over a time that each cell has for itself."""
    passage, gas = balance.passage, balance.gas
    density, velocity, _, pressure = unpack(states)
    fastest = jnp.abs(velocity) + jnp.sqrt(gas.gamma * pressure / density)
    rate = fastest / (cfl * jnp.diff(passage.m)) * passage.volume
    stored = jax.vmap(jax.jacfwd(lambda state, radius: densities(gas, state, radius)))(states, passage.centre_radius)
    band = band_of(balance, states).at[:, 2].add(stored * rate[:, None, None])
    return -solve_band(band, balance(states))
