"""Velocity, chamber pressure, load and friction level from the position alone: least squares that forget."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant, require_converter
from .._design import AbstractDesign, Condition, positive
from .._design_model import SECANT, DesignModel
from ..surroundings import POSITION_NOISE

Mean = Float[Array, " 5"]
Covariance = Float[Array, "5 5"]

AT_REST = (1e-4, 1.0)
"""m/s and Pa; deviation of velocity and pressure of a rod at rest on its stop, with the chamber at atmosphere."""
NOTICED = 3.0
"""Deviations of the sensor above where a rod at rest lies from which it is off; gradually, from twice on altogether."""
HELD = np.array([True, True, False, True, False])
"""Of the mean: what a stop that takes up all force holds, or hides."""


class LoadEstimate(eqx.Module):
    """What is estimated at the last sample, and what the design model is driven by."""

    mean: Mean
    """Position in m, velocity in m/s, pressure in Pa absolute as the flow map has it, load in N, friction level."""
    covariance: Covariance
    """Of the errors of the mean."""
    deflection: Scalar
    """Of the bristles in m."""
    deflection_rate: Scalar
    """m/s"""
    duty: Scalar
    """Percent, as far as the plunger has followed it."""
    stop: Scalar
    """m; what the sensor shows where the rod leaves its open stop."""

    @property
    def position(self) -> Scalar:
        """m"""
        return self.mean[0]

    @property
    def velocity(self) -> Scalar:
        """m/s"""
        return self.mean[1]

    @property
    def pressure(self) -> Scalar:
        """Pa absolute, in the flow map's terms: what it is at a duty that the map says holds it."""
        return self.mean[2]

    @property
    def pressure_deviation(self) -> Scalar:
        """Standard deviation of its error in Pa."""
        return jnp.sqrt(self.covariance[2, 2])

    @property
    def load(self) -> Scalar:
        """Unknown force in N along -x."""
        return self.mean[3]

    @property
    def level(self) -> Scalar:
        """Part by which the bristles' force exceeds the design model's."""
        return self.mean[4]


class LoadObserver(AbstractDesign):
    """Least squares over the [`DesignModel`][] with an unknown force and an unknown friction level, both forgotten.

    The pressure is what the flow map makes of the duty, through a plunger that lags; the position corrects it where
    the pressure moves fast. What is unknown is a process that keeps to its deviation and is forgotten within its
    memory, so that nothing grows where nothing excites it; along the travel the load becomes another one, as springs
    and gas are not as believed. On the open stop the flow map alone goes on. The manual's page of derivations has the
    equations and the Lyapunov function.

    **Raises:** `InputError` for a deviation or a memory that is zero.
    """

    model: DesignModel = eqx.field(default_factory=DesignModel)
    position_noise: Scalar = parameter(POSITION_NOISE, symbol="s_x", unit="m", source="assumed", held=True)
    velocity_drift: Scalar = parameter(5e-3, symbol="q_v", unit="m/s^1.5", source="assumed", lower=0.0)
    pressure_drift: Scalar = parameter(50.0, symbol="q_p", unit="Pa/s^0.5", source="assumed", lower=0.0)
    flow_error: Scalar = parameter(0.2, symbol="q_f", unit="s^0.5", source="assumed", lower=0.0)
    """Of a pressure rate, the part that the flow map may be wrong by for a second."""
    load_deviation: Scalar = parameter(10.0, symbol="s_w", unit="N", source="assumed")
    load_variation: Scalar = parameter(120.0, symbol="q_w", unit="N/m^0.5", source="assumed", lower=0.0)
    """By how much the load changes within a metre of travel, as a walk at random."""
    load_memory: Scalar = parameter(10.0, symbol="T_w", unit="s", source="assumed", held=True)
    level_deviation: Scalar = parameter(1.0, symbol="s_a", unit="1", source="assumed")
    level_memory: Scalar = parameter(300.0, symbol="T_a", unit="s", source="assumed", held=True)
    largest_load: Scalar = parameter(40.0, symbol="w_max", unit="N", source="assumed", held=True)
    largest_level: Scalar = parameter(5.0, symbol="a_max", unit="1", source="assumed", held=True)
    plunger_time: Scalar = parameter(8e-3, symbol="T_p", unit="s", source="2.7, B.1", lower=0.0, held=True)
    stop_width: Scalar = parameter(3e-5, symbol="x_c", unit="m", source="assumed", held=True)
    """From the open stop to twice of this, the rod gradually counts as free."""
    largest_zero_error: Scalar = parameter(5e-4, symbol="x_0", unit="m", source="assumed", lower=0.0, held=True)
    """Of the sensor: up to this what it shows at the start is the open stop, beyond it a rod that is off its stop."""
    stop_time: Scalar = parameter(0.01, symbol="T_c", unit="s", source="assumed", held=True)
    """Of the filter of the position on the stop."""

    @classmethod
    def for_plant(cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any) -> "LoadObserver":
        """On the plant's [`DesignModel`][] or another one, with the mean time constant of its plunger up and down."""
        model = DesignModel.for_plant(plant) if model is None else model
        valve = require_converter(plant, cls.__name__)
        soft, stiff = (valve.stiffness(jnp.asarray(way)) for way in (-1.0, 1.0))
        lag = 0.5 * valve.plunger_damping * (1 / soft + 1 / stiff)
        return cls(**{"model": model, "plunger_time": lag} | settings)

    def conditions(self) -> dict[str, Condition]:
        """What divides."""
        return positive(self, "position_noise", "load_memory", "level_memory", "stop_width", "stop_time")

    def initial_state(self, position: Scalar, ambient: Scalar) -> LoadEstimate:
        """At rest with relaxed bristles, with the chamber at atmosphere, and as uncertain as is known beforehand."""
        nothing = jnp.zeros_like(position)
        mean = jnp.stack([position, nothing, ambient + nothing, nothing, nothing])
        covariance = jnp.diag(jnp.square(self._deviations(nothing)))
        return LoadEstimate(mean, covariance, nothing, nothing, nothing, self._stop_shown(position))

    def _stop_shown(self, position: Scalar) -> Scalar:
        """Where a sensor that shows this at rest shows that the rod leaves its stop, into which its preload presses it:
        at zero, unless the sensor is off by more than noise explains."""
        body = self.model.diaphragm
        sunk = jnp.clip(body.preload / jnp.maximum(body.stop_stiffness, 1.0), 0.0, self.largest_zero_error)
        off = position + sunk
        biased = jnp.clip(off / (NOTICED * self.position_noise) - 1, 0.0, 1.0)
        return jnp.where(position <= self.largest_zero_error, biased * off, 0.0)

    def observed_pressure(self, estimate: LoadEstimate, share: Scalar) -> Scalar:
        """Chamber pressure in Pa absolute, when a share of the load is an error of the flow map in truth."""
        return estimate.pressure + share * estimate.load / self.model.diaphragm.area

    def free(self, estimate: LoadEstimate) -> Scalar:
        """How far the rod is off its open stop, from 0 to 1."""
        return jnp.clip((estimate.position - estimate.stop) / self.stop_width - 1, 0.0, 1.0)

    def step(
        self, state: LoadEstimate, position: Scalar, slow: Scalar, ambient: Scalar, duty: Scalar, period: float
    ) -> LoadEstimate:
        """One sample later.

        **Arguments:** the `position` in m that was read; a velocity in m/s, `slow` enough that noise does not relax
        the bristles; atmosphere in Pa; `duty` in percent, held since the last sample; `period` in s.
        """
        deflection = self.model.friction.deflection_after(state.deflection, slow, slow, period)
        lagged = (self.plunger_time * state.duty + period * duty) / (self.plunger_time + period)
        rate = (deflection - state.deflection) / period
        driven = LoadEstimate(state.mean, state.covariance, deflection, rate, lagged, state.stop)
        return self._correct(state, self._predict(driven, ambient, period), position, period)

    def _predict(self, state: LoadEstimate, ambient: Scalar, period: float) -> LoadEstimate:
        """One linearly implicit step of Euler of mean and covariance."""
        rates, onward = self.rates(state, ambient), transition(self, state, ambient, period)
        mean = state.mean + period * onward @ rates
        noise = jnp.diag(period * self._drifts(rates))
        covariance = onward @ (state.covariance + noise) @ onward.T
        return eqx.tree_at(lambda s: (s.mean, s.covariance), state, (mean, covariance))

    def rates(self, state: LoadEstimate, ambient: Scalar) -> Mean:
        """Time derivative of the mean between samples; the design model where the load is zero, but for its gas."""
        model = self.model
        position, velocity, pressure, load, level = state.mean
        resistance = self.friction(state, velocity) + load
        return jnp.stack(
            [
                velocity,
                model.acceleration(position, velocity, resistance, pressure, ambient),
                model.map_rate(state.duty, position, velocity, pressure, ambient),
                -load / self.load_memory,
                -level / self.level_memory,
            ]
        )

    def friction(self, state: LoadEstimate, velocity: Scalar) -> Scalar:
        """Force of bristles and grease in N along -x, at a velocity in m/s."""
        law = self.model.friction
        lifted = (1 + state.level) * state.deflection
        return self.model.load * law.unloaded_force(lifted, state.deflection_rate, velocity)

    def _drifts(self, rates: Mean) -> Mean:
        """Variance that each second adds, at some rates of the mean."""
        pressure_rate = rates[2]
        nothing = jnp.zeros_like(pressure_rate)
        return jnp.stack(
            [
                nothing,
                nothing + self.velocity_drift**2,
                self.pressure_drift**2 + (self.flow_error * pressure_rate) ** 2,
                2 * self.load_deviation**2 / self.load_memory + self.load_variation**2 * jnp.abs(rates[0]),
                nothing + 2 * self.level_deviation**2 / self.level_memory,
            ]
        )

    def _deviations(self, like: Scalar) -> Mean:
        """Of a rod at rest on its stop."""
        velocity, pressure = AT_REST
        known = (self.position_noise, velocity, pressure, self.load_deviation, self.level_deviation)
        return jnp.stack([each + jnp.zeros_like(like) for each in known])

    def _correct(self, before: LoadEstimate, now: LoadEstimate, position: Scalar, period: float) -> LoadEstimate:
        """By the position that was read, as far as the rod is free."""
        across = now.covariance[:, 0]
        gain = across / (across[0] + self.position_noise**2)
        mean = now.mean + gain * (position - now.position)
        covariance = now.covariance - jnp.outer(gain, across)
        resting, unsure = self._resting(before, now, position, period)
        free = self.free(before)
        return LoadEstimate(
            self._project(resting + free * (mean - resting)),
            unsure + free * (0.5 * (covariance + covariance.T) - unsure),
            free * now.deflection,
            free * now.deflection_rate,
            now.duty,
            now.stop,
        )

    def _resting(
        self, before: LoadEstimate, now: LoadEstimate, position: Scalar, period: float
    ) -> tuple[Mean, Covariance]:
        """Mean and covariance of a rod on its stop, which takes up whatever force there is: what was learned of the
        load is kept, and is no more sure of than it was."""
        follow = period / (self.stop_time + period)
        at_stop = before.mean.at[0].add(follow * (position - before.position)).at[1].set(0.0)
        prior = jnp.square(self._deviations(position)).at[3].set(now.covariance[3, 3])
        known = ~(HELD[:, None] | HELD[None, :])
        covariance = jnp.where(known, now.covariance, jnp.where(np.diag(HELD), jnp.diag(prior), 0.0))
        return jnp.where(HELD, at_stop, now.mean), covariance

    def _project(self, mean: Mean) -> Mean:
        """On what is physical: pressures above zero, friction that brakes, a load within bounds."""
        load = jnp.clip(mean[3], -self.largest_load, self.largest_load)
        level = jnp.clip(mean[4], -1.0, self.largest_level)
        return jnp.stack([mean[0], mean[1], jnp.maximum(mean[2], 0.0), load, level])

    def lyapunov(self, estimate: LoadEstimate, error: Mean) -> Scalar:
        """`V_O` of an error of the mean."""
        return jnp.dot(error, jnp.linalg.solve(estimate.covariance, error))


def transition(
    observer: LoadObserver, state: LoadEstimate, ambient: Scalar, period: float, secant: float = SECANT
) -> Covariance:
    """`(1 - h J)^-1` of one linearly implicit step, `J` the Jacobian of the rates; by elimination.

    **Arguments:** `secant`: Pa to either side over which the flow map's slope is taken.
    """
    h, model, right = period, observer.model, jnp.eye(5, dtype=state.mean.dtype)
    body, (position, velocity, pressure, _, _) = model.diaphragm, state.mean
    swept = model.exponent * body.area * pressure / model.volume(position)
    elastic = model.load * model.friction.bristle_stiffness * state.deflection
    flows = 1 - h * model.map_rate_slope(state.duty, position, velocity, pressure, ambient, secant)
    load = right[3] / (1 + h / observer.load_memory)
    level = right[4] / (1 + h / observer.level_memory)
    pull = body.stiffness * right[0] + body.area * right[2] / flows + load + elastic * level
    inertia = 1 + h / body.mass * (model.sliding_damping + h * body.stiffness + h * body.area * swept / flows)
    speed = (right[1] - h / body.mass * pull) / inertia
    return jnp.stack([right[0] + h * speed, speed, (right[2] + h * swept * speed) / flows, load, level])
