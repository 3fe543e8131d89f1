"""States in which all cells balance: pseudo-transient Newton steps [3.68-3.70], derivatives by the implicit function
theorem."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._types import Scalar, Values
from ._balance import Balance
from ._blocks import COLOURS, REACH, Band, band_of, solve_band
from ._riemann import States, densities, unpack

GROWTH, CAREFUL_GROWTH = (0.5, 10.0), (1.3, 1.6)
"""By what a step in pseudo-time is longer than the one before, at least and at most."""
HASTY_STEPS = 30
"""After which growth is careful, from the first length on: gas that is sonic all along a duct hardly says where."""
LONGEST_MOVE = 0.3
"""How far a step may go in any variable, in its usual size."""
MOST_STEPS = 120
LAST_CFL, LAST_MOVE = 1e12, 1e-6
"""Length of the step that carries derivatives, and how far it may go: where gas is at rest nothing brings it, so that
only time says how dense it is."""
LEAST_ADVANCE, MOST_ATTEMPTS = 1e-3, 40
"""Of continuation: the share of a problem by which it goes on at least, and how often it is tried."""
EXACT, GOOD = 50.0, 0.7
"""Imbalance over what the largest area could pass at which steps end, in units of rounding, and the power of rounding
above which no flow is found: 1e-11 of double precision."""
PATIENCE = 3
"""Steps without a smaller imbalance, once it is good, after which it is rounding."""


class AbstractProblem(eqx.Module):
    """What is to vanish in every cell of a passage, as a function of the states of all of them."""

    balance: eqx.AbstractVar[Balance]
    """Of the cells, with its usual sizes."""

    @abc.abstractmethod
    def __call__(self, states: States) -> Float[Array, "cells 4"]:
        """Mass (kg/s), momentum (N), moment of momentum (N m) and energy (W) of each cell."""

    @abc.abstractmethod
    def is_flow(self, states: States) -> Bool[Array, ""]:
        """Whether states that balance are those of a flow, and not only of numbers that cells allow."""

    @abc.abstractmethod
    def eased(self, share: Values) -> "AbstractProblem":
        """An easier problem on the way to this one: near a share of 0 hardly anything moves, at 1 it is this one."""

    @abc.abstractmethod
    def eased_start(self, start: States, share: Values) -> States:
        """Where to look for the states of an easier problem, when this one's are looked for at `start`."""


class Ending(eqx.Module):
    """How a search for a flow ended."""

    reached: Values
    """Share of the problem whose states were found: 1 for the whole."""
    imbalance: Values
    """Largest imbalance of a cell at the end of the last search, over what gas at rest would carry at its speed of
    sound; not finite where the states were not."""

    @property
    def converged(self) -> Bool[Array, "..."]:
        """Whether the whole problem is solved."""
        return self.reached >= 1


def solve(problem: AbstractProblem, start: States, first_cfl: float, careful_cfl: float) -> tuple[States, Ending]:
    """States that solve a problem, and how the search ended: from the start, or else by continuation.

    Differentiable in both modes with respect to what is in the problem.

    **Arguments:** lengths of the first step in pseudo-time, in transits of a cell by sound, from the start and on the
    way that continuation goes.
    """
    balance = jax.lax.stop_gradient(problem.balance)
    point, ending = jax.lax.stop_gradient(_continue(*jax.lax.stop_gradient((problem, start)), first_cfl, careful_cfl))
    # One more step, whose right side carries all derivatives.
    band, most = _stepping(balance, point, LAST_CFL), LAST_MOVE * balance.scale[None]
    move = -solve_band(band, problem(point.states))
    too_far = jax.lax.stop_gradient(move - jnp.clip(move, -most, most))
    return jnp.where(ending.converged, point.states + move - too_far, point.states), ending


class _Point(eqx.Module):
    """States, and the derivatives there of what is to vanish."""

    states: States
    band: Band

    def where(self, chosen: Bool[Array, ""], other: "_Point") -> "_Point":
        """This point where it is chosen, else the other."""
        return jax.tree.map(lambda mine, theirs: jnp.where(chosen, mine, theirs), self, other)


def _unknown_at(states: States) -> _Point:
    """A point whose derivatives are not known yet."""
    cells, variables = states.shape
    return _Point(states, jnp.zeros((cells, COLOURS, variables, variables), states.dtype))


class _Search(eqx.Module):
    """Where the search stands: the states to look at next, the step that led there and the imbalance that it left;
    `best` is where the least imbalance was so far."""

    states: States
    cfl: Values
    imbalance: Values
    best: _Point
    least: Values
    steps: Array
    waited: Array


def _is_good(imbalance: Values, states: States) -> Bool[Array, ""]:
    return imbalance < jnp.finfo(states.dtype).eps ** GOOD


class _Way(eqx.Module):
    """Where continuation stands: the share of the problem whose states are known, the imbalance that the last search
    left, and how much more is tried next."""

    point: _Point
    known: Values
    imbalance: Values
    advance: Values
    attempts: Array


def _continue(problem: AbstractProblem, start: States, first_cfl: float, careful_cfl: float) -> tuple[_Point, Ending]:
    """States of the whole problem at once, or of ever larger shares of it, each searched from those of the last."""

    def unfinished(at: _Way) -> Array:
        return (at.known < 1) & (at.advance > LEAST_ADVANCE) & (at.attempts < MOST_ATTEMPTS)

    def onward(at: _Way) -> _Way:
        share = jnp.minimum(at.known + at.advance, 1.0)
        near = jnp.where(at.known > 0, at.point.states, problem.eased_start(start, share))
        cfl = jnp.where(at.attempts == 0, first_cfl, careful_cfl)
        point, imbalance = _search(problem.eased(share), near, cfl)
        found = _is_good(imbalance, start) & problem.is_flow(point.states)
        advance = at.advance * jnp.where(found, 2.0, 0.5)
        known = jnp.where(found, share, at.known)
        return _Way(point.where(found, at.point), known, imbalance, advance, at.attempts + 1)

    zero, one = jnp.zeros((), start.dtype), jnp.ones((), start.dtype)
    begin = _Way(_unknown_at(start), zero, zero, one, jnp.zeros((), int))
    end = jax.lax.while_loop(unfinished, onward, begin)
    return end.point, Ending(end.known, end.imbalance)


def _search(problem: AbstractProblem, start: States, first_cfl: Values) -> tuple[_Point, Values]:
    """Where the imbalance is least, and that."""
    balance, scale = problem.balance, problem.balance.scale[None]
    one, nothing, rounding = jnp.ones((), start.dtype), jnp.zeros((), int), jnp.finfo(start.dtype).eps

    def unfinished(at: _Search) -> Array:
        stale = (at.waited >= PATIENCE) & _is_good(at.least, start)
        return (at.least > EXACT * rounding) & ~stale & (at.steps <= MOST_STEPS) & jnp.isfinite(at.imbalance)

    def onward(at: _Search) -> _Search:
        # The only place where a search evaluates its problem: a second one would take as long again to compile.
        residual, band = band_of(problem, at.states)
        imbalance = jnp.max(jnp.abs(residual) / balance.usual[None])
        least, most = (jnp.where(at.steps < HASTY_STEPS, *each) for each in zip(GROWTH, CAREFUL_GROWTH, strict=True))
        longer = at.cfl * jnp.clip(at.imbalance / imbalance, least, most)
        cfl = jnp.where((at.steps == 0) | (at.steps == HASTY_STEPS), first_cfl, longer)
        here, better = _Point(at.states, band), imbalance < at.least
        move = -solve_band(_stepping(balance, here, cfl), residual) / scale
        return _Search(
            at.states + jnp.clip(move, -LONGEST_MOVE, LONGEST_MOVE) * scale,
            cfl,
            imbalance,
            here.where(better, at.best),
            jnp.where(better, imbalance, at.least),
            at.steps + 1,
            jnp.where(better, 0, at.waited + 1),
        )

    begin = _Search(start, one, one, _unknown_at(start), jnp.inf * one, nothing, nothing)
    end = jax.lax.while_loop(unfinished, onward, begin)
    return end.best, end.least


def _stepping(balance: Balance, point: _Point, cfl: Scalar) -> Band:
    """Of the linear problem of a step in pseudo-time, implicit Euler over a time that each cell has for itself."""
    passage, gas = balance.passage, balance.gas
    density, velocity, _, pressure = unpack(point.states)
    fastest = jnp.abs(velocity) + jnp.sqrt(gas.gamma * pressure / density)
    rate = fastest / (cfl * jnp.diff(passage.m)) * passage.volume
    stored = jax.vmap(jax.jacfwd(lambda state, radius: densities(gas, state, radius)))
    return point.band.at[:, REACH].add(stored(point.states, passage.centre_radius) * rate[:, None, None])
