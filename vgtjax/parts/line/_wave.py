"""A line as the wave equation with loss, in space cells [2.16-2.20]."""

import itertools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..._errors import InputError, require_positive
from ..._types import StateLeaf, Values
from .._air import Air
from .._converter import Flow
from ..chamber import GasState
from ._base import AbstractHose
from ._losses import cross_section, friction_rate, speed_of_sound

FASTEST_SOUND = 400.0
"""In m/s: a bound for the choice of time steps, with air at 400 K."""


class WaveState(eqx.Module):
    """Pressure in Pa absolute and mass flow towards the chamber in kg/s, one of each a cell, converter first."""

    pressures: tuple[StateLeaf, ...]
    flows: tuple[StateLeaf, ...]


class WaveLine(AbstractHose):
    """`p' = -(c^2 / A) dm/dx`, `m' = -A dp/dx - (R_t / rho) m` [2.17, 2.18], which together are [2.20].

    Finite volumes of second order that conserve mass; the manual's page on physics says how well they do, and why a
    line below `shortest` is a share of one of that length. The speed of sound is that of ambient air. What arrives has
    ambient temperature, what leaves has the chamber's.
    """

    cells: int = eqx.field(static=True, default=2)
    """Space cells, 2 or more; a numerical setting. The error falls with their square, the step with their number."""
    shortest: float = eqx.field(static=True, default=0.4)
    """Shortest length in m that is divided into cells; a numerical setting, to which the step is proportional."""

    def __check_init__(self) -> None:
        if self.cells < 2:
            raise InputError(f"a wave line needs 2 cells or more, but {self.cells} are asked for; choose e.g. 2")
        require_positive("shortest", self.shortest, "number of metres", "use e.g. 0.4")

    def initial_state(self, air: Air, gas: GasState) -> WaveState:
        """The chamber's pressure all along, nothing flows."""
        return WaveState((gas.pressure,) * self.cells, (jnp.zeros_like(gas.pressure),) * self.cells)

    def port(
        self, air: Air, state: WaveState, gas: GasState, flow: Callable[[GasState], Flow]
    ) -> tuple[GasState, Flow]:
        """The pressure at the converter's end, and the flow that enters: one step of Newton's method from the cell's
        own values, as more entering flow must raise the pressure at once."""
        pressure, reference = _edges(state.pressures)[0][0], _edges(state.flows)[0][0]
        impedance = self._share() * self._impedance(air)

        def entering(p: Values) -> tuple[Values, Values]:
            into = flow(GasState(p, gas.temperature))
            return into.mass_flow, into.temperature

        guess = gas.pressure + self._share() * (pressure - gas.pressure)
        (mass_flow, temperature), (slope, _) = jax.jvp(entering, (guess,), (jnp.ones_like(guess),))
        mass_flow = (mass_flow - slope * impedance * reference) / (1 - slope * impedance)
        pressure = guess + impedance * (mass_flow - reference)
        return GasState(pressure, gas.temperature), Flow(mass_flow, temperature)

    def __call__(self, air: Air, state: WaveState, entering: Flow, gas: GasState) -> tuple[Flow, WaveState]:
        """Flow into the chamber, and rates in Pa/s and kg/s2 [2.17, 2.18]."""
        impedance, crossing = self._impedance(air), self._crossing_rate(air)
        (p_left, p_right), (m_left, m_right) = _edges(state.pressures), _edges(state.flows)
        inner = list(zip(p_right, p_left[1:], m_right, m_left[1:], strict=False))
        flows = [
            entering.mass_flow,
            *(0.5 * (m0 + m1 + (p0 - p1) / impedance) for p0, p1, m0, m1 in inner),
            m_right[-1] + (p_right[-1] - gas.pressure) / impedance,
        ]
        pressures = [
            p_left[0] + impedance * (entering.mass_flow - m_left[0]),
            *(0.5 * (p0 + p1 + (m0 - m1) * impedance) for p0, p1, m0, m1 in inner),
            gas.pressure,
        ]
        rates = WaveState(
            tuple(impedance * crossing * (m0 - m1) for m0, m1 in itertools.pairwise(flows)),
            tuple(
                (p0 - p1) * crossing / impedance - friction * flow
                for (p0, p1), friction, flow in zip(
                    itertools.pairwise(pressures), self._friction_rates(air, state, gas), state.flows, strict=True
                )
            ),
        )
        arriving = entering.mass_flow + self._share() * (flows[-1] - entering.mass_flow)
        return Flow(arriving, jnp.where(arriving > 0, air.temperature, gas.temperature)), rates

    def relaxation(self, air: Air, state: WaveState, gas: GasState) -> WaveState:
        """Pressures oscillate; flows too, unless friction is faster, as in a very narrow line."""
        crossing = self._crossing_rate(air)
        rates = tuple(crossing + friction for friction in self._friction_rates(air, state, gas))
        return WaveState((None,) * self.cells, rates)

    @property
    def longest_step(self) -> float:
        """Time in which sound does not quite cross a cell, which is what Heun's method allows."""
        return self.shortest / (self.cells * FASTEST_SOUND)

    def signals(self, state: WaveState, inflow: Flow) -> dict[str, Array]:
        """Flow into the chamber."""
        return {"m_dot_line": inflow.mass_flow}

    def typical_state(self, gas: GasState) -> WaveState:
        """Pressure of the gas, a tenth of a gram per second."""
        return WaveState((gas.pressure,) * self.cells, (1e-4,) * self.cells)

    def stored_mass(self, air: Air, state: WaveState) -> Values:
        """Mass of gas in the line in kg up to a constant, `A dx / c^2 sum p` [2.17]."""
        return self._share() * sum(state.pressures) / (self._impedance(air) * self._crossing_rate(air))

    def _span(self) -> Values:
        """Length in m of the line that is divided into cells."""
        return jnp.maximum(self.length, self.shortest)

    def _share(self) -> Values:
        return self.length / self._span()

    def _impedance(self, air: Air) -> Values:
        """`c / A` in Pa s/kg."""
        return speed_of_sound(air) / cross_section(self.bore)

    def _crossing_rate(self, air: Air) -> Values:
        """`c / dx` in 1/s."""
        return self.cells * speed_of_sound(air) / self._span()

    def _friction_rates(self, air: Air, state: WaveState, gas: GasState) -> tuple[Values, ...]:
        return tuple(
            friction_rate(air, GasState(pressure, gas.temperature), flow, self.bore, self.viscosity)
            for pressure, flow in zip(state.pressures, state.flows, strict=True)
        )


def _edges(means: tuple[Values, ...]) -> tuple[list[Values], list[Values]]:
    """Values at the left and the right edge of every cell: linear, with the slope of the neighbours, not limited."""
    steps = [right - left for left, right in itertools.pairwise(means)]
    inner = [0.25 * (before + after) for before, after in itertools.pairwise(steps)]
    halves = [0.5 * steps[0], *inner, 0.5 * steps[-1]]
    cells = list(zip(means, halves, strict=True))
    return [mean - half for mean, half in cells], [mean + half for mean, half in cells]
