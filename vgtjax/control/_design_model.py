"""The model that the backstepping controllers are designed on: four states and a flow map [5.4]."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from .._errors import InputError
from .._types import OwnState, Scalar
from ..parameters import Part, parameter
from ..parts import (
    AbstractFlowMap,
    AbstractVaneForce,
    Air,
    Diaphragm,
    IsothermalChamber,
    LuGre,
    NoVaneForce,
    PolynomialFlow,
    Vanes,
)
from ..plants import AbstractPlant, FlowMapPath, reduce_to_static_map

SECANT = 1e3
"""Pa to either side of a pressure between which the slope of the map is taken: at a knot its tangent jumps, and a step
that is linearised by the tangent jumps with it."""
LEAST_VOLUME = 0.1
"""Of the chamber's volume on the open stop; half of it is left on the closed one."""


class Motion(eqx.Module):
    """Position in m and velocity in m/s of the rod as they are known, atmosphere in Pa, turbine inlet in Pa gauge."""

    position: Scalar
    velocity: Scalar
    ambient: Scalar
    turbine: Scalar = eqx.field(default_factory=lambda: jnp.zeros(()))


def vane_load(
    law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: OwnState
) -> tuple[Scalar, PyTree[Scalar]]:
    """Force of the gas on the vanes in N along -x as far as it is known, and rates of what it remembers."""
    return law(_vanes(body, motion), motion.velocity, state)


def vane_load_rate(law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: OwnState) -> Scalar:
    """Time derivative of the force in N/s, at a constant turbine pressure and velocity."""

    def force(position: Scalar, state: OwnState) -> Scalar:
        return vane_load(law, body, Motion(position, motion.velocity, motion.ambient, motion.turbine), state)[0]

    along = (motion.velocity, vane_load(law, body, motion, state)[1])
    return jax.jvp(force, (motion.position, state), along)[1]


def vane_state_after(
    law: AbstractVaneForce, body: Diaphragm, motion: Motion, state: OwnState, period: float
) -> PyTree[Scalar]:
    """What the force remembers a period in s later, by one step of implicit Euler."""
    relaxation = law.relaxation(_vanes(body, motion), motion.velocity, state)
    rates = vane_load(law, body, motion, state)[1]
    return jax.tree.map(lambda s, rate, fade: s + period * rate / (1 + period * fade), state, rates, relaxation)


def _vanes(body: Diaphragm, motion: Motion) -> Vanes:
    return Vanes(body.travel - motion.position, motion.turbine)


class DesignState(eqx.Module):
    """State of the design model, or the rates of its state: m, m/s, m and Pa absolute, and what the vanes remember."""

    position: Scalar
    velocity: Scalar
    deflection: Scalar
    pressure: Scalar
    vanes: PyTree[Scalar] = None


class DesignModel(Part):
    """What a backstepping controller believes of the plant [5.4]; the manual's page of derivations has its equations.

    `load` multiplies the friction of the rod as in [5.7], `exponent` is the polytropic one of the gas, 1 in [5.4]. The
    force `F_v` of the exhaust gas on the vanes is added as far as it is known. It has no end stops: within
    `stop_margin` of one, `off_stops` says how much of the force balance still holds.
    """

    flow_map: AbstractFlowMap = eqx.field(default_factory=PolynomialFlow)
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: LuGre = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    air: Air = eqx.field(default_factory=Air)
    load: Scalar = parameter(1.0, symbol="theta", unit="1", source="5.7")
    exponent: Scalar = parameter(1.0, symbol="n", unit="1", source="5.4", held=True)
    stop_margin: Scalar = parameter(2e-5, symbol="x_s", unit="m", source="assumed", held=True)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, flow_map: AbstractFlowMap | None = None, **settings: Any) -> "DesignModel":
        """That of a plant with LuGre friction; without a flow map, with the plant's own over the duty, or a
        [`SteadyPlungerFlow`][] fitted to it.

        **Raises:** `InputError` for a plant with another friction, or one to which no flow map can be fitted.
        """
        friction, path = lugre_of(plant), plant.air_path
        if flow_map is None:
            flow_map = path.flow_map if isinstance(path, FlowMapPath) else reduce_to_static_map(plant).flow_map
        chamber = IsothermalChamber(volume=plant.chamber.volume)
        return cls(flow_map, chamber, plant.diaphragm, friction, plant.vane_force, plant.air, **settings)

    @property
    def damping(self) -> Scalar:
        """`B` in N s/m."""
        return self.diaphragm.damping + self.load * (self.friction.bristle_damping + self.friction.viscous_damping)

    @property
    def sliding_damping(self) -> Scalar:
        """`b = b_d + theta sigma_2` in N s/m: of the rod that slides."""
        return self.diaphragm.damping + self.load * self.friction.viscous_damping

    def alpha(self, velocity: Scalar) -> Scalar:
        """`1/g(v)` in 1/N."""
        return 1 / self.friction.stribeck(velocity)

    def alpha_slope(self, velocity: Scalar) -> Scalar:
        """`d alpha / dv` in s/(N m); zero where the velocity is, a kink when the Stribeck exponent is 1."""
        return -(self.alpha(velocity) ** 2) * self.friction.stribeck_slope(velocity)

    def slide(self, velocity: Scalar) -> Scalar:
        """`h = |v| alpha(v)` in m/(s N)."""
        return jnp.abs(velocity) * self.alpha(velocity)

    def slide_slope(self, velocity: Scalar, width: Scalar = 0.0) -> Scalar:
        """`dh/dv` in 1/N; zero where the velocity is, a jump unless `v / (|v| + width)` stands for its sign, which is
        exact where `|v|` is far above `width` in m/s."""
        speed = jnp.abs(velocity)
        reach = speed + width
        sign = velocity / jnp.where(reach > 0, reach, 1.0)
        return sign * self.alpha(velocity) + speed * self.alpha_slope(velocity)

    def relaxation_rate(self, velocity: Scalar) -> Scalar:
        """`sigma_0 alpha |v|` in 1/s, at which the bristles' deflection relaxes."""
        return self.friction.relaxation_rate(velocity)

    def stiffness(self, velocity: Scalar) -> Scalar:
        """`S(v)` in N/m; negative for `|v| > g / sigma_1`, some 6.5 mm/s."""
        return self.friction.bristle_stiffness - self.friction.bristle_damping * self.relaxation_rate(velocity)

    def stiffness_slope(self, velocity: Scalar, width: Scalar = 0.0) -> Scalar:
        """`dS/dv` in N s/m2, with `width` as of `slide_slope`."""
        return -self.friction.bristle_stiffness * self.friction.bristle_damping * self.slide_slope(velocity, width)

    def acceleration(
        self, position: Scalar, velocity: Scalar, resistance: Scalar, pressure: Scalar, ambient: Scalar
    ) -> Scalar:
        """Of the rod in m/s2, under a resistance in N along -x that takes in `theta F_f` and `F_v`."""
        body = self.diaphragm
        spring = body.balance_force(position) + body.damping * velocity
        return (body.drive_force(ambient, pressure) - spring - resistance) / body.mass

    def stopped(self, position: Scalar, acceleration: Scalar) -> Scalar:
        """An acceleration in m/s2 without what drives the rod into an end stop, which takes that up."""
        open_stop, closed_stop = self._near_stops(position)
        return acceleration + open_stop * jnp.maximum(-acceleration, 0.0) - closed_stop * jnp.maximum(acceleration, 0.0)

    def off_stops(self, position: Scalar) -> Scalar:
        """Share of the force balance that holds: 1 between the stops, 0 on one, linear over `stop_margin`."""
        open_stop, closed_stop = self._near_stops(position)
        return (1 - open_stop) * (1 - closed_stop)

    def _near_stops(self, position: Scalar) -> tuple[Scalar, Scalar]:
        """How near the open stop and the closed one are, from 0 to 1; an endless travel has neither."""
        travel = self.diaphragm.travel
        stops = jnp.isfinite(travel)
        left = jnp.stack([position, jnp.where(stops, travel, 0.0) - position])
        near = jnp.where(stops, jnp.clip(1 - left / self.stop_margin, 0.0, 1.0), 0.0)
        return near[0], near[1]

    def friction_force(self, velocity: Scalar, deflection: Scalar) -> Scalar:
        """`theta F_f` in N, which is `(B - b_d) v + theta S z`."""
        viscous = (self.damping - self.diaphragm.damping) * velocity
        return viscous + self.load * self.stiffness(velocity) * deflection

    def deflection_rate(self, velocity: Scalar, deflection: Scalar) -> Scalar:
        """`z'` in m/s."""
        return velocity - self.relaxation_rate(velocity) * deflection

    def vane_load(self, motion: Motion, state: OwnState) -> tuple[Scalar, PyTree[Scalar]]:
        """`F_v` in N along -x, and the rates of what it remembers, per second."""
        return vane_load(self.vane_force, self.diaphragm, motion, state)

    def vane_load_rate(self, motion: Motion, state: OwnState) -> Scalar:
        """`F_v'` in N/s."""
        return vane_load_rate(self.vane_force, self.diaphragm, motion, state)

    def vane_state_after(self, motion: Motion, state: OwnState, period: float) -> PyTree[Scalar]:
        """What the force remembers a period in s later."""
        return vane_state_after(self.vane_force, self.diaphragm, motion, state, period)

    def volume(self, position: Scalar) -> Scalar:
        """`V` in m3, of which a part is always left: a sensor may show the rod anywhere."""
        displaced = self.diaphragm.displaced_volume(position)
        return self.chamber.gas_volume(jnp.minimum(displaced, (1 - LEAST_VOLUME) * self.chamber.volume))

    @property
    def gas_energy(self) -> Scalar:
        """`R T` in J/kg."""
        return self.air.gas_constant * self.air.temperature

    def pressure_rate(self, flow: Scalar, position: Scalar, velocity: Scalar, pressure: Scalar) -> Scalar:
        """`p'` in Pa/s under a mass flow in kg/s into the chamber."""
        swept = self.diaphragm.area * velocity * pressure
        return self.exponent * (self.gas_energy * flow + swept) / self.volume(position)

    def map_rate(self, duty: Scalar, position: Scalar, velocity: Scalar, pressure: Scalar, ambient: Scalar) -> Scalar:
        """`p'` in Pa/s with the map's flow under a duty in percent."""
        return self.pressure_rate(self.flow_map(duty, pressure, ambient), position, velocity, pressure)

    def map_rate_slope(
        self,
        duty: Scalar,
        position: Scalar,
        velocity: Scalar,
        pressure: Scalar,
        ambient: Scalar,
        secant: float = SECANT,
    ) -> Scalar:
        """Of that rate over the pressure in 1/s, between `secant` Pa below it and above it."""
        below, above = (
            self.map_rate(duty, position, velocity, at, ambient) for at in (pressure - secant, pressure + secant)
        )
        return (above - below) / (2 * secant)

    def flow_for(self, pressure_rate: Scalar, position: Scalar, velocity: Scalar, pressure: Scalar) -> Scalar:
        """Mass flow in kg/s into the chamber that gives a pressure rate in Pa/s."""
        swept = self.diaphragm.area * velocity * pressure
        return (self.volume(position) * pressure_rate / self.exponent - swept) / self.gas_energy

    def rates(self, state: DesignState, duty: Scalar, ambient: Scalar, turbine: Scalar = 0.0) -> DesignState:
        """Time derivative of the state [5.4] under a duty in percent, an atmosphere in Pa and a turbine in Pa gauge."""
        position, velocity, pressure = state.position, state.velocity, state.pressure
        motion = Motion(position, velocity, ambient, turbine)
        load, vane_rates = self.vane_load(motion, state.vanes)
        resistance = self.friction_force(velocity, state.deflection) + load
        return DesignState(
            velocity,
            self.acceleration(position, velocity, resistance, pressure, ambient),
            self.deflection_rate(velocity, state.deflection),
            self.map_rate(duty, position, velocity, pressure, ambient),
            vane_rates,
        )


def lugre_of(plant: AbstractPlant) -> LuGre:
    """The friction of a plant.

    **Raises:** `InputError` where its bristles can't be observed.
    """
    if not isinstance(plant.friction, LuGre):
        raise InputError(
            f"a plant must have LuGre friction, whose bristles the design observes, but it has "
            f"{type(plant.friction).__name__}; use LuGre, or a PI",
            "plant",
        )
    return plant.friction


def lighter(model: DesignModel) -> Scalar:
    """The printed mass over that of a design model: gains that are forces over mass change in proportion to it."""
    return DesignModel().diaphragm.mass / model.diaphragm.mass
