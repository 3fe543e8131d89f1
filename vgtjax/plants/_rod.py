"""The rod with all that acts on it, which every model of the actuator has in common [2.34]."""

import equinox as eqx
from jaxtyping import Array, PyTree

from .._types import StateLeaf, Values
from ..parts import AbstractFriction, AbstractVaneForce, Body, Contact, Diaphragm, LuGre, NoVaneForce, Vanes
from ..traces import Start
from ._base import AbstractModel, Inner


class RodState(eqx.Module):
    """State of the rod, its friction and the vanes, one scalar a leaf (SI units)."""

    body: Body
    friction: PyTree[StateLeaf]
    vanes: PyTree[StateLeaf]


class Rod(eqx.Module):
    """Diaphragm, friction and vane force, put together."""

    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: AbstractFriction = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)

    def start(self, start: Start, drive_force: Values) -> RodState:
        """At rest where the trace says, or else in static balance with the drive in N along +x."""
        body = self.diaphragm.start(start, drive_force)
        return RodState(body, self.friction.initial_state(), self.vane_force.initial_state())

    def rates(
        self, state: RodState, drive_force: Values, turbine_pressure: Values, ambient_shift: Values | None = None
    ) -> RodState:
        """Time derivative of the state [2.34].

        **Arguments:** `drive_force` in N along +x; `turbine_pressure` in Pa gauge; `ambient_shift` as in
        [`Drive`][vgtjax.traces.Drive].
        """
        body = state.body
        vanes = self._vanes(body, turbine_pressure, ambient_shift)
        vane_force, vane_rate = self.vane_force(vanes, body.velocity, state.vanes)
        applied = self.diaphragm.applied_force(body, drive_force - vane_force)
        friction_force, friction_rate = self.friction(self._contact(body, vanes), state.friction, applied)
        return RodState(Body(body.velocity, (applied - friction_force) / self.diaphragm.mass), friction_rate, vane_rate)

    def relaxation(
        self,
        state: RodState,
        turbine_pressure: Values,
        thinness: Values | float = 0.0,
        ambient_shift: Values | None = None,
    ) -> RodState:
        """Relaxation rates in 1/s of the rod's velocity, of friction and of the vanes.

        `thinness` is that of the gas behind the diaphragm, [`AbstractChamber.thinness`][vgtjax.parts.AbstractChamber].
        """
        body = state.body
        vanes = self._vanes(body, turbine_pressure, ambient_shift)
        contact = self._contact(body, vanes)
        damping = self.friction.damping(contact) + self.vane_force.damping(vanes, body.velocity)
        return RodState(
            Body(None, self.diaphragm.damping_rate(body, damping, thinness)),
            self.friction.relaxation(contact, state.friction),
            self.vane_force.relaxation(vanes, body.velocity, state.vanes),
        )

    def signals(
        self, state: RodState, turbine_pressure: Values, ambient_shift: Values | None = None
    ) -> dict[str, Array]:
        """Position, velocity, and what friction and vanes show."""
        body = state.body
        vanes = self._vanes(body, turbine_pressure, ambient_shift)
        return {
            "x_d": body.position,
            "v_d": body.velocity,
            **self.friction.signals(state.friction),
            **self.vane_force.signals(vanes, body.velocity, state.vanes),
        }

    def typical_state(self) -> RodState:
        """A centimetre, a tenth of a metre per second."""
        return RodState(Body(1e-2, 0.1), self.friction.typical_state(), self.vane_force.typical_state())

    def _vanes(self, body: Body, turbine_pressure: Values, ambient_shift: Values | None) -> Vanes:
        return Vanes(self.diaphragm.travel - body.position, turbine_pressure, ambient_shift)

    def _contact(self, body: Body, vanes: Vanes) -> Contact:
        return Contact(body.velocity, self.diaphragm.mass, vanes)


class AbstractRodModel(AbstractModel):
    """A model with a rod, whose parts are its own too."""

    rod: eqx.AbstractVar[Rod]

    diaphragm = Inner[Diaphragm]("rod")
    friction = Inner[AbstractFriction]("rod")
    vane_force = Inner[AbstractVaneForce]("rod")
