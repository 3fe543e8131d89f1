"""The model that the backstepping controllers are designed on: four states and a flow map [5.4]."""

from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp

from ..air import Air, Scalar
from ..chamber import IsothermalChamber
from ..diaphragm import Diaphragm
from ..friction import LuGre
from ..parameters import parameter
from ..reduced import AbstractFlowMap, PolynomialFlow


class DesignState(eqx.Module):
    """State of the design model, or the rates of its state: m, m/s, m and Pa absolute."""

    position: Scalar
    velocity: Scalar
    deflection: Scalar
    pressure: Scalar


class DesignModel(eqx.Module):
    """What a backstepping controller believes of the plant [5.4].

    With `V = V_0 - A_d x`, `alpha = 1/g` (which the print never defines), `S(v) = sigma_0 (1 - sigma_1 alpha |v|)` and
    `B = b_d + theta (sigma_1 + sigma_2)`:

        x' = v;   m v' = (p_atm - p) A_d - F_0 - k_sm x - B v - theta S(v) z;   z' = v - sigma_0 alpha |v| z
        p' = (R T f(u, p) + A_d v p) / V

    It has no end stops. `load` multiplies the friction of the rod, as in [5.7].
    """

    flow_map: AbstractFlowMap = eqx.field(default_factory=PolynomialFlow)
    chamber: IsothermalChamber = eqx.field(default_factory=IsothermalChamber)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: LuGre = eqx.field(default_factory=LuGre)
    air: Air = eqx.field(default_factory=Air)
    load: Scalar = parameter(1.0, symbol="theta", unit="1", source="5.7")

    @classmethod
    def of(cls, model: Any, flow_map: AbstractFlowMap, **settings: Any) -> Self:
        """That of a model with LuGre friction, for instance an [`Actuator`][], with a map of its flow."""
        chamber = IsothermalChamber(volume=model.chamber.volume)
        return cls(flow_map, chamber, model.diaphragm, model.friction, model.air, **settings)

    @property
    def damping(self) -> Scalar:
        """`B` in N s/m."""
        return self.diaphragm.damping + self.load * (self.friction.bristle_damping + self.friction.viscous_damping)

    def alpha(self, velocity: Scalar) -> Scalar:
        """`1/g(v)` in 1/N."""
        return 1 / self.friction.stribeck(velocity)

    def alpha_slope(self, velocity: Scalar) -> Scalar:
        """`d alpha / dv` in s/(N m); zero where the velocity is, a kink when the Stribeck exponent is 1."""
        model, power = self.friction, self.friction.stribeck_exponent
        ratio = jnp.abs(velocity) / model.stribeck_velocity
        steepness = power * ratio ** (power - 1) / model.stribeck_velocity
        fall = (model.static_force - model.coulomb_force) * steepness * jnp.exp(-(ratio**power))
        return self.alpha(velocity) ** 2 * fall * jnp.sign(velocity)

    def forgetting(self, velocity: Scalar) -> Scalar:
        """`sigma_0 alpha |v|` in 1/s, the rate at which the bristles forget their deflection."""
        return self.friction.bristle_stiffness * self.alpha(velocity) * jnp.abs(velocity)

    def stiffness(self, velocity: Scalar) -> Scalar:
        """`S(v)` in N/m; negative for `|v| > g / sigma_1`, some 6.5 mm/s."""
        return self.friction.bristle_stiffness - self.friction.bristle_damping * self.forgetting(velocity)

    def stiffness_slope(self, velocity: Scalar) -> Scalar:
        """`dS/dv` in N s/m2; zero where the velocity is, a kink."""
        model = self.friction
        growth = jnp.sign(velocity) * self.alpha(velocity) + jnp.abs(velocity) * self.alpha_slope(velocity)
        return -model.bristle_stiffness * model.bristle_damping * growth

    def acceleration(
        self, position: Scalar, velocity: Scalar, friction: Scalar, pressure: Scalar, ambient: Scalar
    ) -> Scalar:
        """Of the rod in m/s2, under a friction force in N along -x that takes in all of `theta F_f`."""
        body = self.diaphragm
        spring = body.preload + body.stiffness * position + body.damping * velocity
        return ((ambient - pressure) * body.area - spring - friction) / body.mass

    def friction_force(self, velocity: Scalar, deflection: Scalar) -> Scalar:
        """`theta F_f` in N, which is `(B - b_d) v + theta S z`."""
        viscous = (self.damping - self.diaphragm.damping) * velocity
        return viscous + self.load * self.stiffness(velocity) * deflection

    def deflection_rate(self, velocity: Scalar, deflection: Scalar) -> Scalar:
        """`z'` in m/s."""
        return velocity - self.forgetting(velocity) * deflection

    def volume(self, position: Scalar) -> Scalar:
        """`V` in m3."""
        return self.chamber.gas_volume(self.diaphragm.displaced_volume(position))

    @property
    def gas_energy(self) -> Scalar:
        """`R T` in J/kg."""
        return self.air.gas_constant * self.air.temperature

    def pressure_rate(self, flow: Scalar, position: Scalar, velocity: Scalar, pressure: Scalar) -> Scalar:
        """`p'` in Pa/s under a mass flow in kg/s into the chamber."""
        swept = self.diaphragm.area * velocity * pressure
        return (self.gas_energy * flow + swept) / self.volume(position)

    def flow_for(self, pressure_rate: Scalar, position: Scalar, velocity: Scalar, pressure: Scalar) -> Scalar:
        """Mass flow in kg/s into the chamber that gives a pressure rate in Pa/s."""
        swept = self.diaphragm.area * velocity * pressure
        return (self.volume(position) * pressure_rate - swept) / self.gas_energy

    def rates(self, state: DesignState, duty: Scalar, ambient: Scalar) -> DesignState:
        """Time derivative of the state [5.4] under a duty in percent and an atmosphere in Pa."""
        position, velocity, pressure = state.position, state.velocity, state.pressure
        friction = self.friction_force(velocity, state.deflection)
        flow = self.flow_map(duty, pressure, ambient)
        return DesignState(
            velocity,
            self.acceleration(position, velocity, friction, pressure, ambient),
            self.deflection_rate(velocity, state.deflection),
            self.pressure_rate(flow, position, velocity, pressure),
        )
