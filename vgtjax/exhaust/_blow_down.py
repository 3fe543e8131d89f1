"""Cylinders that empty into a manifold, and the manifold into a turbine: filling and emptying."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Scalar, Values
from ..parts import flow_between
from ._engine import Engine
from ._operating_point import OperatingPoint

STAGES, LEANS, WEIGHTS = np.array([0, 1, 1, 2]), np.array([0, 0.5, 0.5, 1.0]), np.array([1, 2, 2, 1]) / 6
"""The classical method of Runge and Kutta: where it takes a slope, how far along the last one, how much it counts."""

PerCylinder = Float[Array, " cylinders"]


class Cylinders(eqx.Module):
    """State of the gas in the cylinders, one value each, the one that fired last first.

    The temperature is the one that the gas would have at the volume at which the valve opens. Piston work leaves it
    alone, so nothing changes while a valve is shut, and nothing jumps when it opens.
    """

    mass: PerCylinder
    """kg"""
    expanded_temperature: PerCylinder
    """K"""


class Gas(eqx.Module):
    """State of the gas in the manifold."""

    mass: Scalar
    """kg"""
    heat: Scalar
    """Mass times temperature in kg K, so that nothing is lost to rounding when energy is added up."""

    @property
    def temperature(self) -> Values:
        """K"""
        return self.heat / self.mass


class State(eqx.Module):
    """State of all gas between the pistons and the turbine."""

    cylinders: Cylinders
    manifold: Gas


class Geometry(eqx.Module):
    """What the crank angle alone decides of every cylinder."""

    area: PerCylinder
    """Effective area of the valves in m2."""
    volume: PerCylinder
    """m3"""
    compression: PerCylinder
    """Temperature over that at the volume at which the valve opens, for gas that nothing but the piston acts on."""


def geometry(engine: Engine, angle: Scalar) -> Geometry:
    """Of all cylinders, `angle` deg after the firing TDC of the one that fired last."""
    angles = angle + engine.interval * jnp.arange(engine.cylinders, dtype=jnp.result_type(angle))
    volume = engine.volume(angles)
    ratio = engine.volume(engine.valve.opening) / volume
    return Geometry(engine.valve.area(angles), volume, ratio ** (engine.gas.heat_capacity_ratio - 1))


def manifold_pressure(engine: Engine, gas: Gas) -> Values:
    """Pa absolute."""
    return engine.gas.gas_constant * gas.heat / engine.manifold_volume


def rates(engine: Engine, point: OperatingPoint, state: State, now: Geometry) -> State:
    """Time derivative of the state per second, from mass and energy balances of every volume.

    `m c_v T' = -p V' - (w c_p T_u - w c_v T)` in a cylinder, with the flow `w` and the temperature `T_u` upstream, and
    `(m c_v T)' = sum w c_p T_u - q c_p T - h A (T - T_w)` in the manifold.
    """
    gamma, constant = engine.gas.heat_capacity_ratio, engine.gas.gas_constant
    cylinders, manifold = state.cylinders, state.manifold
    temperature = cylinders.expanded_temperature * now.compression
    pressure = constant * cylinders.mass * temperature / now.volume
    inlet = manifold_pressure(engine, manifold)
    flow, upstream = flow_between(engine.gas, now.area, pressure, temperature, inlet, manifold.temperature)
    taken = flow * (gamma * upstream - temperature) / (cylinders.mass * now.compression)
    leaving = point.leaving(engine.gas, inlet, manifold.temperature)
    cooling = engine.wall_conductance * (manifold.temperature - engine.wall_temperature) * (gamma - 1) / constant
    heating = gamma * (jnp.sum(flow * upstream) - leaving * manifold.temperature) - cooling
    return State(Cylinders(-flow, -taken), Gas(jnp.sum(flow) - leaving, heating))


def fire(state: State, point: OperatingPoint) -> State:
    """The state one firing later: every cylinder is where the next one was, and the first holds a new charge.

    The cylinder that fires once more has long been shut; what was left in it is part of the charge.
    """

    def renewed(charge: Values, values: PerCylinder) -> PerCylinder:
        return jnp.concatenate([jnp.reshape(charge, (1,)).astype(values.dtype), values[:-1]])

    cylinders = Cylinders(
        renewed(point.trapped_mass, state.cylinders.mass),
        renewed(point.opening_temperature, state.cylinders.expanded_temperature),
    )
    return State(cylinders, state.manifold)


def step(engine: Engine, point: OperatingPoint, state: State, stages: Geometry, turn: float) -> State:
    """The state `turn` deg later, by the classical method of Runge and Kutta; `stages` at begin, middle and end.

    They are a loop, as four copies of the rates and of their derivatives take four times as long to compile.
    """
    seconds = turn / (6 * point.engine_speed)  # rpm to deg/s

    def ahead(direction: State, share: Values) -> State:
        return jax.tree.map(lambda y, k: y + share * seconds * k, state, direction)

    def stage(carry: tuple[State, State], at: tuple[Geometry, Values, Values]) -> tuple[tuple[State, State], None]:
        (slope, mean), (now, lean, weight) = carry, at
        slope = rates(engine, point, ahead(slope, lean), now)
        return (slope, jax.tree.map(lambda total, k: total + weight * k, mean, slope)), None

    now = jax.tree.map(lambda leaf: leaf[STAGES], stages)
    nothing = jax.tree.map(jnp.zeros_like, state)
    leans, weights = (jnp.asarray(numbers, state.manifold.mass.dtype) for numbers in (LEANS, WEIGHTS))
    (_, mean), _ = jax.lax.scan(stage, (nothing, nothing), (now, leans, weights))
    return ahead(mean, 1.0)
