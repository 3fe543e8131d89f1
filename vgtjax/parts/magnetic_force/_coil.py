"""Magnetic force from the electrical circuit [2.1-2.6]."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar, StateLeaf, Values
from ...parameters import parameter
from ._base import AbstractMagneticForce

VACUUM_PERMEABILITY = 4e-7 * math.pi
"""In H/m."""


class Winding(eqx.Module):
    """State of the coil: current in A."""

    current: StateLeaf


class Coil(AbstractMagneticForce):
    """Coil on a core with an air gap: `U = R i + d(L i)/dt` [2.1], `F = i^2 |dL/dx_p| / 2` [2.5, 2.6].

    `L = N^2 A mu_r mu_0 / x_eq` [2.2] with `x_eq = x_0 + mu_r (x_t + x_p)`: the print has `x_t - x_p` [2.3], which
    counts `x_p` downwards (erratum). Put it in with `Converter(magnetic_force=Coil())`. The manual's page on physics
    says where the numbers are from.
    """

    turns: Scalar = parameter(7500.0, symbol="N", unit="1", source="assumed", held=True)
    core_area: Scalar = parameter(2e-4, symbol="A", unit="m2", source="assumed", held=True)
    core_length: Scalar = parameter(0.05, symbol="x_0", unit="m", source="assumed", held=True)
    relative_permeability: Scalar = parameter(1000.0, symbol="mu_r", unit="1", source="assumed", held=True)
    gap: Scalar = parameter(0.025, symbol="x_t", unit="m", source="assumed", held=True)
    resistance: Scalar = parameter(11.0, symbol="R_i", unit="ohm", source="assumed", held=True)
    supply_voltage: Scalar = parameter(12.0, symbol="U_s", unit="V", source="assumed", held=True)
    duty_map: Float[Array, " 3"] = parameter(
        (1.7552, -0.88707, 0.10348),
        symbol="c",
        unit=("1", "1", "1"),
        source="fitted to B.1",
        positive=False,
        assumed=True,
    )
    rest_iterations: ClassVar[int] = 30
    nearest: float = eqx.field(static=True, default=-2.5e-3)
    """Plunger position in m below which inductance goes on along its tangent; a numerical setting."""

    def voltage(self, pwm: Values) -> Values:
        """Effective voltage in V at a duty in percent."""
        duty = 0.01 * pwm
        c1, c2, c3 = (self.duty_map[k] for k in range(3))
        return self.supply_voltage * ((c3 * duty + c2) * duty + c1) * duty

    def inductance(self, position: Values) -> tuple[Values, Values]:
        """Inductance in H [2.2], and its derivative with respect to the plunger's position in H/m [2.4, corrected].

        A core that reaches the plunger above `nearest` is a failed simulation: then both are NaN.
        """
        within = jnp.maximum(position, self.nearest)
        path = self.core_length + self.relative_permeability * (self.gap + within)  # x_eq
        path = jnp.where(path > 0, path, jnp.nan)
        permeability = self.relative_permeability * VACUUM_PERMEABILITY
        inductance = self.turns**2 * self.core_area * permeability / path
        slope = -inductance * self.relative_permeability / path
        return inductance + slope * (position - within), slope

    def initial_state(self, pwm: Values) -> Winding:
        """The current `U / R`."""
        return Winding(self.voltage(pwm) / self.resistance)

    def __call__(self, pwm: Values, position: Values, velocity: Values, state: Winding) -> tuple[Values, Winding]:
        """Pull [2.6], and `i' = (U - R i - i L' v) / L` in A/s [2.1]."""
        inductance, slope = self.inductance(position)
        drop = (self.resistance + slope * velocity) * state.current
        return _pull(state.current, slope), Winding((self.voltage(pwm) - drop) / inductance)

    def steady_pull(self, pwm: Values, position: Values) -> Values:
        """Pull of the current `U / R` [2.6]."""
        return _pull(self.initial_state(pwm).current, self.inductance(position)[1])

    def relaxation(self, position: Values, state: Winding) -> Winding:
        """`R / L`."""
        return Winding(self.resistance / self.inductance(position)[0])

    def signals(self, state: Winding) -> dict[str, Array]:
        """The current `i` in A."""
        return {"i": state.current}

    def typical_state(self) -> Winding:
        """The current at full voltage."""
        return Winding(self.supply_voltage / self.resistance)


def _pull(current: Values, slope: Values) -> Values:
    return -0.5 * current**2 * slope
