"""Diaphragm, rod and end stops [2.34]."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._types import Scalar, StateLeaf, Values
from ..parameters import Part, parameter
from ..traces import Start

LOOK_AHEAD = 5e-4
"""s, the default step, in which a fast rod goes far into a stop."""
CUSHION_DAMPING = LOOK_AHEAD * 1.4e5 / 6e-7
"""N s/m5, of air at ambient pressure whose stiffness `gamma p / V` at its least volume pushes for a step."""
USUAL_SPEED = 0.05
"""m/s, at which the printed rod in a step comes no deeper into a stop than it rests there."""


class Body(eqx.Module):
    """State of the diaphragm and its rod: position in m (pulled in, vanes closing, is positive), velocity in m/s."""

    position: StateLeaf
    velocity: StateLeaf


ENDLESS_MIDDLE = 5e-3
"""m, where a diaphragm without stops is taken to work: about the middle of the printed travel."""


class Diaphragm(Part):
    """Spring-loaded diaphragm between two end stops at 0 and `travel`.

    The stops are not in the thesis but in every device; their contact law is Hunt and Crossley's (1975), whose
    force is continuous at contact. With an infinite `travel` there are none at all, at zero neither: an axis that moves
    freely both ways.
    """

    place: ClassVar[str] = "diaphragm"

    mass: Scalar = parameter(0.63, symbol="m_d", unit="kg", source="B.2")
    area: Scalar = parameter(2.9224e-3, symbol="A_d", unit="m2", source="B.2", held=True)
    preload: Scalar = parameter(49.46, symbol="F_0", unit="N", source="B.2", positive=False)
    stiffness: Scalar = parameter(12000.0, symbol="k_sm", unit="N/m", source="B.2")
    damping: Scalar = parameter(0.0, symbol="b_d", unit="N s/m", source="B.2, erratum", lower=0.0, held=True)
    travel: Scalar = parameter(10.13e-3, symbol="x_max", unit="m", source="3.6", infinite=True)
    stop_stiffness: Scalar = parameter(1e6, symbol="k_stop", unit="N/m", source="assumed")
    stop_damping: Scalar = parameter(20.0, symbol="d", unit="s/m", source="assumed")

    def stop_force(self, body: Body) -> Values:
        """Force of the end stops in N, positive against the open one."""
        into_open = jnp.maximum(-body.position, 0.0) * jnp.maximum(1 - self.stop_damping * body.velocity, 0.0)
        past_travel = jnp.maximum(body.position - self.travel, 0.0)
        into_closed = past_travel * jnp.maximum(1 + self.stop_damping * body.velocity, 0.0)
        return self._contact_stiffness() * (into_open - into_closed)

    def applied_force(self, body: Body, drive_force: Values) -> Values:
        """All forces on the rod but friction in N along +x [2.34], under a drive in N along +x."""
        return (
            drive_force
            - self.damping * body.velocity
            - self.preload
            - self.stiffness * body.position
            + self.stop_force(body)
        )

    def damping_rate(self, body: Body, friction_damping: Values, thinness: Values | float = 0.0) -> Values:
        """Rate in 1/s at which damping, friction in N s/m and the contact with a stop slow the rod.

        Hunt and Crossley's damper of a rod that rests against a stop is twice as strong as friction, and lighter rods
        than the printed one diverge without it. Where a fast rod may be `LOOK_AHEAD` later counts as well: it is deep
        in its stop before a step has seen it there. So does gas that the diaphragm has nearly squeezed out, by the
        `thinness` of its chamber.
        """
        into_stop = jnp.maximum(-body.position, body.position - self.travel)
        lead = LOOK_AHEAD * jnp.maximum(jnp.abs(body.velocity) - USUAL_SPEED, 0.0)
        stop_damping = self._contact_stiffness() * jnp.maximum(into_stop + lead, 0.0) * self.stop_damping
        thin = self.area * thinness
        return (self.damping + friction_damping + stop_damping + CUSHION_DAMPING * thin * thin) / self.mass

    def drive_force(self, ambient: Values, pressure: Values) -> Values:
        """Force in N along +x of pressures in Pa absolute, `(p_atm - p_act) A_d` [2.34]."""
        return (ambient - pressure) * self.area

    def balance_force(self, position: Values) -> Values:
        """Drive in N that holds the rod at a position in m between the stops."""
        return self.preload + self.stiffness * position

    def balance_pressure(self, ambient: Values, position: Values, force: Values = 0.0) -> Values:
        """Chamber pressure in Pa absolute that holds the rod there against one more force in N along -x, without
        friction."""
        return ambient - (self.balance_force(position) + force) / self.area

    @property
    def middle(self) -> Values:
        """Of the travel in m; of an endless one that of the printed one, more or less."""
        return jnp.where(jnp.isfinite(self.travel), 0.5 * self.travel, ENDLESS_MIDDLE)

    def start(self, start: Start, drive_force: Values) -> Body:
        """At rest where the trace says, or else in static balance with the drive (N along +x)."""
        balanced = self.rest_position(drive_force)
        measured = start.position_known & ~start.at_rest
        position = jnp.where(measured, start.position, balanced)
        return Body(position, jnp.zeros_like(position))

    def rest_position(self, drive_force: Values) -> Values:
        """Position in m at which the spring and the stops balance a drive along +x in N, without friction."""
        force = drive_force - self.preload
        closed = jnp.where(jnp.isfinite(self.travel), self.travel, 0.0)
        stopped = _reciprocal(self.stiffness + self._contact_stiffness())
        past = (force + self._contact_stiffness() * closed) * stopped
        reaches = jnp.isfinite(self.travel) & (force > self.stiffness * closed)
        free = force * _reciprocal(self.stiffness)
        return jnp.where(force < 0, force * stopped, jnp.where(reaches, past, free))

    def _contact_stiffness(self) -> Values:
        return jnp.where(jnp.isfinite(self.travel), self.stop_stiffness, 0.0)

    def displaced_volume(self, position: Values) -> Values:
        """Volume in m3 that the diaphragm takes from the chamber, `A_d x_d` [2.41]."""
        return self.area * position


def _reciprocal(stiffness: Values) -> Values:
    """Compliance in m/N, zero for an axis without a spring, whose rest position is then taken as zero."""
    present = stiffness > 0
    return jnp.where(present, 1 / jnp.where(present, stiffness, 1.0), 0.0)
