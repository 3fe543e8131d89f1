"""A line that delays and attenuates the flow [2.24-2.32]."""

import functools
import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._errors import InputError, require_positive
from ..._types import Values
from .._air import Air
from .._converter import Flow
from ..chamber import GasState
from ._base import AbstractHose
from ._losses import friction_rate, speed_of_sound

Lags = tuple[Values, ...]
"""One number per lag."""


class DelayLine(AbstractHose):
    """Flow that arrives after `tau = L / c`, less by the factor `exp(-R_t R T / (2 p) L / c)` [2.29], either way.

    The converter sees the chamber's pressure, and what leaves has the chamber's temperature. The speed of sound is that
    of ambient air; `p` and `T` of the factor are the chamber's [2.25]. The factor loses steady flow too (erratum);
    where that matters, use [`WaveLine`][]. Lags side by side stand for the dead time: the manual's page on physics says
    how well.
    """

    cells: int = eqx.field(static=True, default=3)
    """Lags, 2 to 5; a numerical setting."""
    shortest_lag: float = eqx.field(static=True, default=1 / 3e3)
    """In s; a numerical setting without effect above `L = 0.29 m`. Heun's steps of 0.5 ms follow this one."""

    def __check_init__(self) -> None:
        if not 2 <= self.cells <= 5:
            raise InputError(f"a delay line has 2 to 5 cells, but {self.cells} are asked for; choose e.g. 3")
        require_positive("shortest_lag", self.shortest_lag, "number of seconds", "use e.g. 3e-4")

    def initial_state(self, air: Air, gas: GasState) -> Lags:
        """Nothing flows."""
        return (jnp.zeros_like(gas.pressure),) * self.cells

    def port(self, air: Air, state: Lags, gas: GasState, flow: Callable[[GasState], Flow]) -> tuple[GasState, Flow]:
        """The chamber."""
        return gas, flow(gas)

    def __call__(self, air: Air, state: Lags, entering: Flow, gas: GasState) -> tuple[Flow, Lags]:
        """What arrives [2.29], of ambient temperature, or what leaves, of the chamber's; and `m_k'` in kg/s2."""
        delay = self.length / speed_of_sound(air)
        weights = self._weights(delay / self._span(air))
        missing = tuple(entering.mass_flow - flow for flow in state)
        # The weighted sum of the lags, written as what is missing: a short delay misses a part of it only.
        delayed = entering.mass_flow - sum(weight * part for weight, part in zip(weights, missing, strict=True))
        friction = friction_rate(air, gas, delayed, self.bore, self.viscosity)
        arriving = delayed * jnp.exp(-0.5 * friction * delay)
        rates = tuple(part / lag for part, lag in zip(missing, self._lags(air), strict=True))
        return Flow(arriving, jnp.where(arriving > 0, air.temperature, gas.temperature)), rates

    def relaxation(self, air: Air, state: Lags, gas: GasState) -> Lags:
        """One over each lag."""
        return tuple(1 / lag for lag in self._lags(air))

    @property
    def longest_step(self) -> float:
        """Any: `shortest_lag` bounds the rates."""
        return math.inf

    def signals(self, state: Lags, inflow: Flow) -> dict[str, Array]:
        """Flow into the chamber."""
        return {"m_dot_line": inflow.mass_flow}

    def typical_state(self, gas: GasState) -> tuple[float, ...]:
        """A tenth of a gram per second."""
        return (1e-4,) * self.cells

    def _span(self, air: Air) -> Values:
        """The delay in s that the lags are made for: `tau`, unless one of them were below `shortest_lag`."""
        return jnp.maximum(self.length / speed_of_sound(air), self.shortest_lag / _fractions(self.cells)[0])

    def _lags(self, air: Air) -> Lags:
        span = self._span(air)
        return tuple(fraction * span for fraction in _fractions(self.cells))

    def _weights(self, share: Values) -> Lags:
        """Weights of the lags for a delay that is `share` of the span."""
        return tuple(_without_constant(row, share) for row in _weight_polynomials(self.cells))


def _fractions(cells: int) -> tuple[float, ...]:
    """Lags as fractions of the delay they make together."""
    return tuple((0.22 * cells * np.linspace(0.6, 1.4, cells)).tolist())


@functools.cache
def _weight_polynomials(cells: int) -> tuple[tuple[float, ...], ...]:
    """Every lag's weight as a polynomial in the share, from its first power on."""
    factorials = [math.factorial(j) for j in range(cells)]
    solved = np.linalg.inv(np.vander(_fractions(cells), increasing=True).T) / factorials
    first = solved[:, :1] + solved[:, 1:2]  # the conditions for j = 0 and j = 1 both have the share itself
    return tuple(map(tuple, np.hstack([first, solved[:, 2:]]).tolist()))


def _without_constant(coefficients: tuple[float, ...], share: Values) -> Values:
    value = coefficients[-1] * share
    for coefficient in reversed(coefficients[:-1]):
        value = (value + coefficient) * share
    return value
