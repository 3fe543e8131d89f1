"""Steps in time of the balances of all cells."""

import abc

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._types import Scalar, Values
from ._balance import Balance, Ends
from ._newton import AbstractProblem, solve
from ._riemann import States, states_of, unpack

DIAGONAL = 1 - 1 / np.sqrt(2)
"""Of Alexander's method (1977): the larger root has ten times the error."""
FIRST_CFL, CAREFUL_CFL = 1e4, 5.0
"""Of the search for the end of a step: it begins near, where this is Newton's method. Gas that a plenum is opened to
needs the second, over a shorter time."""

NORM = 32
"""Of the cells' rates: that of 200 equal ones is 18 % above the largest."""


class AbstractStepper(eqx.Module):
    """How states advance in time."""

    @abc.abstractmethod
    def __call__(
        self, balance: Balance, begin: Ends, end: Ends, states: States, duration: Scalar
    ) -> tuple[States, Bool[Array, ""]]:
        """States after a duration in s over which the ends move evenly, and whether they were found."""


class Implicit(AbstractStepper):
    """Two implicit stages of second order (Alexander 1977), stable however long the step is: one that is longer than
    any wave needs ends in the steady state [3.68-3.70].

    What leaves a cell enters its neighbour, exactly.
    """

    def __call__(
        self, balance: Balance, begin: Ends, end: Ends, states: States, duration: Scalar
    ) -> tuple[States, Bool[Array, ""]]:
        """See the base class."""
        here, share = balance.stored(states), DIAGONAL * duration

        def stage(carry: tuple[States, Array], at: Array) -> tuple[tuple[States, Array], Bool[Array, ""]]:
            near, before = carry
            after, ending = solve(
                _Stage(balance.between(begin.towards(end, at)), before, share), near, FIRST_CFL, CAREFUL_CFL
            )
            gained = (balance.stored(after) - here) * (1 - DIAGONAL) / DIAGONAL
            return (after, here + gained), ending.converged

        # A loop, as two searches take twice as long to compile.
        (after, _), found = jax.lax.scan(stage, (states, here), jnp.asarray([DIAGONAL, 1.0], states.dtype))
        return after, jnp.all(found)


class _Stage(AbstractProblem):
    """A stage of an implicit step: a cell stores what it had and gains."""

    balance: Balance
    before: Float[Array, "cells 4"]
    duration: Scalar

    def __call__(self, states: States) -> Float[Array, "cells 4"]:
        """See the base class."""
        return (self.balance.stored(states) - self.before) / self.duration + self.balance(states)

    def is_flow(self, states: States) -> Bool[Array, ""]:
        """Gas may go both ways while it fills a passage."""
        return jnp.ones((), bool)

    def eased(self, share: Values) -> "_Stage":
        """The same over a share of the time."""
        return _Stage(self.balance, self.before, share * self.duration)

    def eased_start(self, start: States, share: Values) -> States:
        """The same start."""
        return start


class Explicit(AbstractStepper):
    """The method of Heun, which keeps what is monotonic so (Shu and Osher 1988), in as many steps as sound needs.

    For waves in ducts: between nearly closed vanes its steps are 2e-8 s.
    """

    cfl: float = eqx.field(static=True, default=0.5)
    """Share of a cell that the fastest wave crosses in a step."""
    most_steps: int = eqx.field(static=True, default=16**3)
    """From one time to the next."""

    def __call__(
        self, balance: Balance, begin: Ends, end: Ends, states: States, duration: Scalar
    ) -> tuple[States, Bool[Array, ""]]:
        """See the base class."""
        radius = balance.passage.centre_radius
        volume = balance.passage.volume[:, None]

        def stage(carry: tuple[Array, Array], at: Array) -> tuple[tuple[Array, Array], None]:
            stored, step = carry
            there = balance.between(begin.towards(end, at / duration))
            return (stored - step * there(states_of(there.gas, stored / volume, radius)), step), None

        def onward(carry: tuple[Array, Array]) -> tuple[Array, Array]:
            passed, stored = carry
            rate = _rate(balance, states_of(balance.gas, stored / volume, radius))
            step = jnp.minimum(self.cfl / rate, duration - passed)
            # A loop, as two copies of the balance and of its derivatives take twice as long to compile.
            (twice, _), _ = jax.lax.scan(stage, (stored, step), jnp.stack([passed, passed + step]))
            return passed + step, 0.5 * (stored + twice)

        def unfinished(carry: tuple[Array, Array]) -> Array:
            return carry[0] < duration

        passed, stored = eqxi.while_loop(
            unfinished,
            onward,
            (jnp.zeros_like(duration), balance.stored(states)),
            max_steps=self.most_steps,
            kind="bounded",
        )
        after = states_of(balance.gas, stored / volume, radius)
        return after, (passed >= duration) & jnp.all(jnp.isfinite(after))


def _rate(balance: Balance, states: States) -> Values:
    """Cells that the fastest wave crosses in a second, or a little more: a norm in place of the largest one, where
    derivatives of the step's length would jump from cell to cell."""
    density, velocity, _, pressure = unpack(states)
    rates = (jnp.abs(velocity) + jnp.sqrt(balance.gas.gamma * pressure / density)) / jnp.diff(balance.passage.m)
    largest = jax.lax.stop_gradient(jnp.max(rates))
    return largest * jnp.sum((rates / largest) ** NORM) ** (1 / NORM)
