"""From gas before the turbine to force at the rod: flow through the nozzle, moment on the vanes, linkage."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._errors import InputError, SimulationError, require_finite, require_positive
from ..._types import Scalar, Values
from ...parameters import Part, as_float_array, optional_float_array, parameter
from ...turbine import CELLS, Gas, Inlet, Nozzle, Passage, PassageFlow, States, steady_near
from .._vanes import Crank

CRANK_RANGE = (4.0, 37.0)
"""Degrees of the crank in which forces are known; those at the ends are held beyond."""
CHECKED_ANGLES = np.linspace(*CRANK_RANGE, 25)
"""Degrees of the crank at which a nozzle must work."""
HIGHEST_PRESSURE = 4.5e5
"""Pa absolute before the turbine up to which forces are known; that there is held beyond."""
TOTAL_TEMPERATURE, OUTLET_PRESSURE, SPEED_RATIO = 900.0, 1.05e5, 0.6
"""K before the turbine, Pa absolute behind it, speed of the wheel's blades over the spouting velocity: all assumed."""
WHEEL_SPEED = 12000.0
"""rad/s of a wheel whose speed is given by nothing else: what the ratio makes of 1.4 bar. Assumed."""


class Linkage(Part):
    """From the crank to the vanes: the ring turns all of them by `ratio` degrees per degree of the crank.

    The print's own figures disagree: 3.12 deg/mm over 10.13 mm are 31.6 degrees of the crank, and vanes that turn by 48
    (erratum E21), hence the ratio.
    """

    place = "linkage"
    ratio: Scalar = parameter(48 / 31.6, symbol="i_v", unit="-", source="3.6, 3.14, assumed", held=True)
    closed_angle: Scalar = parameter(4.0, symbol="phi_0", unit="deg", source="assumed", held=True)
    """Of the vanes from the tangent, at `closed_crank`."""
    closed_crank: Scalar = parameter(4.0, symbol="C_r0", unit="deg", source="3.14", positive=False, held=True)

    def vane_angle(self, crank_angle: Values) -> Values:
        """Of the vanes from the tangent, in rad, at a crank angle in deg."""
        return jnp.radians(self.closed_angle + self.ratio * (crank_angle - self.closed_crank))


def one_of_both(speed_ratio: Any, wheel_speed: Any) -> tuple[Any, Any]:
    """The ratio and the speed by which a wheel turns, one of which is `None`.

    **Raises:** `InputError` for both.
    """
    if speed_ratio is not None and wheel_speed is not None:
        raise InputError(
            f"a wheel must turn by either a speed_ratio or a wheel_speed, but they are {speed_ratio} and {wheel_speed} "
            "rad/s; give one of them"
        )
    return (SPEED_RATIO if wheel_speed is None and speed_ratio is None else speed_ratio), wheel_speed


class Stage(eqx.Module):
    """All that the flow through the turbine depends on; see [`Turbine`][] for what they are.

    Its wheel turns by a ratio to the spouting velocity, 0.6 unless another is given, or at a speed that is given in
    rad/s.

    **Raises:** `InputError` for both.
    """

    nozzle: Nozzle = eqx.field(default_factory=Nozzle)
    linkage: Linkage = eqx.field(default_factory=Linkage)
    crank: Crank = eqx.field(default_factory=Crank)
    gas: Gas = eqx.field(default_factory=Gas)
    total_temperature: Scalar = eqx.field(converter=as_float_array, default=TOTAL_TEMPERATURE)
    outlet_pressure: Scalar = eqx.field(converter=as_float_array, default=OUTLET_PRESSURE)
    speed_ratio: Scalar | None = eqx.field(converter=optional_float_array, default=None)
    wheel_speed: Scalar | None = eqx.field(converter=optional_float_array, default=None)

    def __post_init__(self) -> None:
        self.speed_ratio, self.wheel_speed = one_of_both(self.speed_ratio, self.wheel_speed)

    def vane_angle(self, crank_angle: Values) -> Values:
        """Of the vanes from the tangent, in rad, at a crank angle in deg."""
        return self.linkage.vane_angle(crank_angle)

    def require_working(self) -> None:
        """**Raises:** `InputError` for a gas, a state or a geometry that does not work at some angle of the crank."""
        self.gas.require_working()
        self.nozzle.require_working()
        require_positive("vane_force.total_temperature", self.total_temperature, "temperature in K", "correct it")
        require_positive("vane_force.outlet_pressure", self.outlet_pressure, "pressure in Pa absolute", "correct it")
        if float(self.outlet_pressure) >= HIGHEST_PRESSURE:
            raise InputError(
                f"vane_force.outlet_pressure must be below {HIGHEST_PRESSURE / 1e5:g} bar absolute, where the table "
                f"ends, but it is {float(self.outlet_pressure) / 1e5:g} bar; correct it",
                "values",
            )
        for name in ("speed_ratio", "wheel_speed"):
            if getattr(self, name) is not None:
                require_finite(f"vane_force.{name}", getattr(self, name), "number", "correct it")
        for crank_angle in CHECKED_ANGLES:
            self.nozzle.require_range(self.vane_angle(crank_angle))

    def works(self) -> Bool[Array, ""]:
        """Whether gas, state and geometry work at all angles of the crank, also where they are traced; see
        `require_working`."""
        outlet = self.outlet_pressure
        state = (self.total_temperature > 0) & (outlet > 0) & (outlet < HIGHEST_PRESSURE)
        room = self.nozzle.works(self.vane_angle(jnp.asarray(CHECKED_ANGLES, outlet.dtype)))
        return self.gas.works() & state & jnp.all(room)

    def speed_at(self, total_pressure: Values) -> Values:
        """Of the wheel in rad/s at a total pressure in Pa absolute: the one that is given, or by the ratio of the
        blades' speed to the spouting velocity."""
        if self.wheel_speed is not None:
            return jnp.broadcast_to(self.wheel_speed, jnp.shape(total_pressure))
        assert self.speed_ratio is not None, "there is one of both"
        expanded = self.gas.expanded_temperature(1.0, self.outlet_pressure / total_pressure)
        falling = 2 * self.gas.heat_capacity * self.total_temperature * (1 - expanded)
        # Without a pressure difference the wheel stands still; the root's slope is infinite there.
        spouting = jnp.sqrt(jnp.maximum(falling, 1e-6))
        return self.speed_ratio * spouting / self.nozzle.rotor.inlet_radius

    def force(self, moment: Values) -> Values:
        """At the rod in N against +x, of a moment on each vane in N m, by virtual work [3.72, corrected]."""
        turned = self.linkage.ratio * self.crank.ratio * jnp.pi / 180
        return self.nozzle.vanes * moment * turned

    def passage(self, total_pressure: Values, crank_angle: Values, cells: int = CELLS) -> tuple[Passage, Inlet]:
        """What the gas flows through at Pa absolute and deg, and what it comes from."""
        speed = self.speed_at(total_pressure)
        passage = self.nozzle.passage(self.vane_angle(crank_angle), speed, cells, self.gas)
        return passage, self.nozzle.inlet(total_pressure, self.total_temperature)


@eqx.filter_jit
def flow_at(
    stage: Stage, total_pressure: Scalar, crank_angle: Scalar, cells: int = CELLS, near: States | None = None
) -> tuple[PassageFlow, Float[Array, " 2"], States]:
    """Steady flow; force at the rod in N and mass flow in kg/s; and the states where the search ended.

    **Arguments:** Pa absolute and deg; `near`: where to search from.
    """
    passage, inlet = stage.passage(total_pressure, crank_angle, cells)
    flow, states = steady_near(passage, inlet, stage.outlet_pressure, stage.gas, near)
    moment, _ = stage.nozzle.vane_moment(passage, flow)
    return flow, jnp.stack([stage.force(moment), flow.mass_flow]), states


def no_steady_flow(stage: Stage, total_pressure: float, crank_angle: float) -> SimulationError:
    """The error of a point without a steady state, which is searched once more to say how; Pa absolute and deg."""
    ending = flow_at(stage, jnp.asarray(total_pressure), jnp.asarray(crank_angle), CELLS)[0].ending
    assert ending is not None, "a search has an end"
    imbalance = float(ending.imbalance)
    left = f"left an imbalance of {imbalance:.1g}" if np.isfinite(imbalance) else "left the finite numbers"
    how = (
        f"from gas at rest the search came to {float(ending.reached):.0%} of the pressure difference, with a wheel as "
        f"much slower, and {left} beyond"
    )
    if bool(ending.converged):
        how = "the search from the flow beside it failed"
    return SimulationError(
        f"no steady flow through the nozzle was found at {total_pressure / 1e5:.4g} bar absolute and a crank angle of "
        f"{crank_angle:.4g} deg: {how}; check the nozzle's geometry, or give it less swirl or speed there"
    )
