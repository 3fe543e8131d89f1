"""States in which all cells balance: pseudo-transient Newton steps [3.68-3.70], derivatives by the implicit function
theorem."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._types import Values
from ._blocks import band_of, solve_band
from ._gas import Gas
from ._passage import Passage
from ._riemann import States, densities, unpack

GROWTH, CAREFUL_GROWTH = (1.5, 10.0), (1.3, 1.6)
"""By what a step in pseudo-time is longer than the one before, at least and at most."""
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


class AbstractBalance(eqx.Module):
    """What the cells of a passage lose, as a function of their states, with what both are scaled by."""

    passage: eqx.AbstractVar[Passage]
    gas: eqx.AbstractVar[Gas]
    scale: eqx.AbstractVar[Float[Array, " 4"]]
    """Usual sizes of `ln rho`, `V_m`, `r V_u` and `ln p`."""
    usual: eqx.AbstractVar[Float[Array, " 4"]]
    """Of mass, momentum, moment of momentum and energy that pass in a second."""

    @abc.abstractmethod
    def __call__(self, states: States) -> Float[Array, "cells 4"]:
        """What each cell loses in a second: mass (kg), momentum (N), moment of momentum (N m), energy (W)."""


def solve(balance: AbstractBalance, start: States, *first_cfl: float) -> tuple[States, Bool[Array, ""]]:
    """States in which nothing is lost, and whether they were found.

    Differentiable in both modes with respect to what is in the balance.

    **Arguments:** `first_cfl`: length of the first step in pseudo-time, in transits of a cell by sound; with several,
    the search begins again with the next one when it has found nothing.
    """
    states, imbalance = _searches(*jax.lax.stop_gradient((balance, start)), first_cfl)
    states = jax.lax.stop_gradient(states)
    # One more step, whose right side carries all derivatives.
    band = jax.lax.stop_gradient(band_of(jax.lax.stop_gradient(balance), states))
    moved = states - solve_band(band, balance(states))
    converged = jax.lax.stop_gradient(_is_good(imbalance, states))
    return jnp.where(converged, moved, states), converged


def imbalance_of(balance: AbstractBalance, states: States) -> Values:
    """Largest imbalance of a cell over what gas at rest would carry at its speed of sound."""
    return jnp.max(jnp.abs(balance(states)) / balance.usual[None])


class _Search(eqx.Module):
    """Where the search stands; `best` are the states with the least imbalance so far."""

    states: States
    cfl: Values
    imbalance: Values
    best: States
    least: Values
    steps: Array
    waited: Array


def _is_good(imbalance: Values, states: States) -> Bool[Array, ""]:
    return imbalance < jnp.finfo(states.dtype).eps ** GOOD


def _searches(balance: AbstractBalance, start: States, first_cfl: tuple[float, ...]) -> tuple[States, Values]:
    """What the first search finds that finds something, or else the last one."""
    lengths = jnp.asarray(first_cfl, start.dtype)

    def again(carry: tuple[Array, States, Values]) -> tuple[Array, States, Values]:
        attempt = carry[0]
        return attempt + 1, *_search(balance, start, lengths[attempt])

    def unfinished(carry: tuple[Array, States, Values]) -> Array:
        attempt, _, imbalance = carry
        return (attempt < len(first_cfl)) & ~_is_good(imbalance, start)

    begin = jnp.zeros((), int), start, jnp.full((), jnp.inf, start.dtype)
    _, states, imbalance = jax.lax.while_loop(unfinished, again, begin)
    return states, imbalance


def _search(balance: AbstractBalance, start: States, first_cfl: Values) -> tuple[States, Values]:
    """States of the least imbalance, and that."""
    first = imbalance_of(balance, start)
    zero, rounding = jnp.zeros((), int), jnp.finfo(start.dtype).eps

    def unfinished(at: _Search) -> Array:
        stale = (at.waited >= PATIENCE) & _is_good(at.least, start)
        return (at.least > EXACT * rounding) & ~stale & (at.steps < MOST_STEPS) & jnp.isfinite(at.imbalance)

    def onward(at: _Search) -> _Search:
        hasty = at.steps < HASTY_STEPS
        cfl = jnp.where(at.steps == HASTY_STEPS, first_cfl, at.cfl)
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

    begin = _Search(start, first_cfl, first, start, first, zero, zero)
    end = jax.lax.while_loop(unfinished, onward, begin)
    return end.best, end.least


def _step(balance: AbstractBalance, states: States, cfl: Values) -> States:
    """A step of implicit Euler over a time that each cell has for itself."""
    passage, gas = balance.passage, balance.gas
    density, velocity, _, pressure = unpack(states)
    fastest = jnp.abs(velocity) + jnp.sqrt(gas.gamma * pressure / density)
    rate = fastest / (cfl * jnp.diff(passage.m)) * passage.volume
    stored = jax.vmap(jax.jacfwd(lambda state, radius: densities(gas, state, radius)))(states, passage.centre_radius)
    band = band_of(balance, states).at[:, 2].add(stored * rate[:, None, None])
    return -solve_band(band, balance(states))
