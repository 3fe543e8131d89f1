"""Flow over duty and pressure when the plunger is always at rest [5.3]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._types import Values
from ...parameters import parameter
from ._base import FULL_DUTY, AbstractFlowMap, duty_by_bisection, equilibrium_pressure
from ._lift_table import LiftTable
from ._roots import polynomial


class SteadyPlungerFlow(AbstractFlowMap):
    """The table of flow over plunger position, with the plunger where duty and pressure balance it [5.3].

    `x_p = c (p_eq(u) - p)` with one compliance for each direction, since the return spring acts on one side only
    (erratum). Where the orifice to the reservoir is saturated, flow does not depend on duty.
    """

    equilibrium: Float[Array, " 5"] = equilibrium_pressure()
    compliance: Float[Array, " 2"] = parameter(
        (8.7125e-8, 3.9602272727e-8), symbol="c", unit="m/Pa", source="2.7, B.1", held=True
    )
    """Below and above zero."""
    table: LiftTable = eqx.field(default_factory=LiftTable)

    @property  # type: ignore[misc]
    def ambient(self) -> Values:  # type: ignore[override]
        """That of the table."""
        return self.table.ambient

    def position(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Where the plunger rests, in m."""
        gauged = pressure - self.gauge_shift(ambient)
        lack = polynomial(self.equilibrium, jnp.clip(duty, 0.0, FULL_DUTY)) - gauged
        return lack * jnp.where(lack < 0, self.compliance[0], self.compliance[1])

    def __call__(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s."""
        return self.table(self.position(duty, pressure, ambient), pressure, ambient)

    def valid(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Bool[Array, "..."]:
        """Whether plunger and pressure lie within the table."""
        gauged = pressure - self.gauge_shift(ambient)
        at, table = self.position(duty, pressure, ambient), self.table
        within = (gauged >= table.pressure[0]) & (gauged <= table.pressure[-1])
        return within & (at >= table.position[0]) & (at <= table.position[-1]) & (duty >= 0) & (duty <= FULL_DUTY)

    def duty_for(self, flow: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """By bisection."""
        return duty_by_bisection(self, flow, pressure, ambient)
