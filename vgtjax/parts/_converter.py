"""The electro-pneumatic pressure converter: magnetic force, plunger, and its two orifices [2.7-2.12, B.1-B.3]."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from .._errors import require_positive
from .._types import Scalar, StateLeaf, Tree, Values
from ..parameters import Part, parameter
from ._air import Air, orifice_flow
from .magnetic_force import AbstractMagneticForce, StaticForce

PRINTED_MEMBRANE = 2000.0
"""N/m [B.1]."""
GENTLE_OPENING = 1e-5
"""m of lift over which the atmosphere's orifice opens where derivatives are taken; see [`without_chatter`][]."""

SHARP_OPENING = 1e-8
"""m of lift over which it opens where the jump itself is wanted; see [`with_sharp_seat`][]."""


class Plunger(eqx.Module):
    """State of the plunger: position in m (up, towards open atmosphere, is positive) and velocity in m/s."""

    position: StateLeaf
    velocity: StateLeaf


class Flow(eqx.Module):
    """Mass flow in kg/s into a volume, and the temperature in K of the gas that flows."""

    mass_flow: Values
    temperature: Values


class ConverterState(eqx.Module):
    """State of the converter: its plunger, and what the magnetic force remembers."""

    plunger: Plunger
    magnet: PyTree[StateLeaf]


def _as_force(given: Any) -> AbstractMagneticForce:
    return given if isinstance(given, AbstractMagneticForce) else StaticForce(given)


class Converter(Part):
    """Solenoid pressure converter. A plunger above zero opens the atmosphere, below zero the reservoir."""

    place: ClassVar[str] = "converter"

    plunger_mass: Scalar = parameter(0.01, symbol="m_p", unit="kg", source="B.1", held=True)
    membrane_stiffness: Scalar = parameter(PRINTED_MEMBRANE, symbol="k_mem", unit="N/m", source="B.1")
    return_spring_stiffness: Scalar = parameter(2400.0, symbol="k_s1", unit="N/m", source="B.1")
    plunger_damping: Scalar = parameter(22.0, symbol="b_p", unit="N s/m", source="B.1")
    actuator_area: Scalar = parameter(1.7425e-4, symbol="A_act", unit="m2", source="B.1", held=True)
    atmosphere_area: Scalar = parameter(1.7652e-4, symbol="A_atm", unit="m2", source="B.1", held=True)
    reservoir_area: Scalar = parameter(3.1416e-6, symbol="A_res", unit="m2", source="B.1", held=True)
    magnetic_force: AbstractMagneticForce = eqx.field(default_factory=StaticForce, converter=_as_force)
    """Coefficients of the static quartic may be given instead."""
    reservoir_orifice_slope: Scalar = parameter(0.360e-3, symbol="dA/dx", unit="m", source="B.2")
    reservoir_orifice_saturation: Scalar = parameter(2.5e-3, symbol="x_sat", unit="m", source="B.2")
    atmosphere_orifice: Float[Array, " 3"] = parameter(
        (2.299e-8, 1.68e-4, 0.342), symbol="c", unit=("m2", "m", "1"), source="B.3"
    )
    opening_width: float = eqx.field(static=True, default=1e-6)
    """Lift in m over which the printed jump `c0` of the atmosphere orifice opens, above zero, with the printed
    membrane; a numerical setting, see `opening_lift`."""
    widest_opening: float = eqx.field(static=True, default=0.0256)
    """Largest flow in kg/s into a volume, for each Pa between the pressures and each m3 of it; a numerical setting:
    air fills a chamber at 3000 1/s then, which no orifice of the printed plunger comes near."""

    @property
    def opening_lift(self) -> Values:
        """Lift in m over which the jump opens: `opening_width`, less for a stiffer membrane.

        A plunger that hovers there needs a force of stiffness times lift. Were the lift the same for all membranes, a
        fit would read their stiffness off that force, which the actuator itself does not have.
        """
        return self.opening_width * (PRINTED_MEMBRANE / self.membrane_stiffness)

    def __check_init__(self) -> None:
        require_positive("widest_opening", self.widest_opening, "flow in kg/(s Pa m3)", "use e.g. 0.0256")

    def start(self, pwm: Values, ambient: Values, reservoir: Values, pressure: Values) -> ConverterState:
        """State at rest at a chamber pressure in Pa absolute, after a duty in percent has been held for long."""
        lift = self.rest_position(pwm, ambient, reservoir, pressure)
        return ConverterState(Plunger(lift, jnp.zeros_like(lift)), self.magnetic_force.initial_state(pwm))

    def rates(
        self, state: ConverterState, pwm: Values, ambient: Values, reservoir: Values, pressure: Values
    ) -> ConverterState:
        """Time derivative of the state [2.7] under a duty in percent and the pressure that the converter feels."""
        plunger = state.plunger
        pull, magnet_rate = self.magnetic_force(pwm, plunger.position, plunger.velocity, state.magnet)
        acceleration = self.acceleration(plunger, pull, ambient, reservoir, pressure)
        return ConverterState(Plunger(plunger.velocity, acceleration), magnet_rate)

    def relaxation(self, state: ConverterState) -> ConverterState:
        """Relaxation rates in 1/s of the plunger's velocity, the fastest of the model, and of the magnet."""
        damping = self.plunger_damping / self.plunger_mass
        return ConverterState(
            Plunger(None, damping), self.magnetic_force.relaxation(state.plunger.position, state.magnet)
        )

    def signals(self, state: ConverterState) -> dict[str, Array]:
        """Plunger `x_p` in m and `v_p` in m/s, and what the magnetic force shows."""
        plunger = state.plunger
        return {"x_p": plunger.position, "v_p": plunger.velocity, **self.magnetic_force.signals(state.magnet)}

    def typical_state(self) -> ConverterState:
        """Millimetres, tenths of metres per second."""
        return ConverterState(Plunger(1e-3, 0.1), self.magnetic_force.typical_state())

    def static_force(self, pull: Values, ambient: Values, reservoir: Values, pressure: Values) -> Values:
        """Force in N on a closed plunger at rest: pressures (Pa absolute) on its three areas, and the magnet's pull."""
        return ambient * self.atmosphere_area - reservoir * self.reservoir_area - pull - pressure * self.actuator_area

    def acceleration(
        self, plunger: Plunger, pull: Values, ambient: Values, reservoir: Values, pressure: Values
    ) -> Values:
        """Acceleration of the plunger in m/s2 [2.7] under the magnet's pull in N.

        The return spring acts only above zero (erratum).
        """
        position = plunger.position
        force = (
            self.static_force(pull, ambient, reservoir, pressure)
            - self.membrane_stiffness * position
            - self.return_spring_stiffness * jnp.maximum(position, 0.0)
            - self.plunger_damping * plunger.velocity
        )
        return force / self.plunger_mass

    def rest_position(self, pwm: Values, ambient: Values, reservoir: Values, pressure: Values) -> Values:
        """Position in m at which [2.7] balances at rest."""
        position = jnp.zeros_like(pressure)
        for _ in range(self.magnetic_force.rest_iterations):
            pull = self.magnetic_force.steady_pull(pwm, position)
            force = self.static_force(pull, ambient, reservoir, pressure)
            position = force / self.stiffness(force)
        return position

    def stiffness(self, force: Values) -> Values:
        """Of the plunger's springs in N/m, against a force in N: both above zero, the membrane alone below."""
        return self.membrane_stiffness + jnp.where(force > 0, self.return_spring_stiffness, 0.0)

    def working_pressure(self, pwm: Values, ambient: Values, reservoir: Values) -> Values:
        """Chamber pressure in Pa at which the plunger rests closed, between reservoir and atmosphere [2.8]."""
        pull = self.magnetic_force.steady_pull(pwm, jnp.zeros_like(pwm))
        balance = self.static_force(pull, ambient, reservoir, jnp.zeros_like(pwm)) / self.actuator_area
        return jnp.clip(balance, reservoir, ambient)

    def orifice_area(self, position: Values) -> Values:
        """Area in m2 of the one orifice that is open at a plunger position in m [B.2, B.3]."""
        c0, c1, c2 = (self.atmosphere_orifice[k] for k in range(3))
        opened = jnp.minimum(position / self.opening_lift, 1.0)
        to_atmosphere = (c2 * position + c1) * position + c0 * opened
        to_reservoir = self.reservoir_orifice_slope * jnp.minimum(-position, self.reservoir_orifice_saturation)
        return jnp.where(position < 0, to_reservoir, to_atmosphere)

    def flow(
        self,
        air: Air,
        position: Values,
        ambient: Values,
        reservoir: Values,
        pressure: Values,
        temperature: Values,
        volume: Values | None = None,
    ) -> Flow:
        """Flow into a volume at `pressure` (Pa absolute) and `temperature` (K) behind the converter.

        Only one orifice is open, so only one flow is evaluated, between the volume and the atmosphere
        (position above zero) or the reservoir. A `volume` in m3 fills no faster than `widest_opening` has it.
        """
        source = jnp.where(position < 0, reservoir, ambient)
        area = self.orifice_area(position)
        conductance = None if volume is None else self.widest_opening * volume
        return Flow(*orifice_flow(air, area, source, pressure, temperature, conductance))


def without_chatter(model: Tree) -> Tree:
    """A model whose converter opens its atmosphere orifice over ten micrometres of lift: at the default of one, some
    actuators chatter as they release, so finely that a derivative sees nothing else."""
    return _with_opening(model, lambda width: max(width, GENTLE_OPENING))


def with_sharp_seat(model: Tree) -> Tree:
    """A model whose converter opens its atmosphere orifice over ten nanometres of lift, nearly the jump that it is.

    For values only: derivatives of what chatters there are no use.
    """
    return _with_opening(model, lambda width: min(width, SHARP_OPENING))


def _with_opening(model: Tree, change: Callable[[float], float]) -> Tree:
    def changed(node: Any) -> Any:
        if not isinstance(node, Converter):
            return node
        return dataclasses.replace(node, opening_width=change(node.opening_width))

    return jax.tree.map(changed, model, is_leaf=lambda node: isinstance(node, Converter))
