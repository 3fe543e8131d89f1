"""Adaptive backstepping with a dual friction observer [5.46-5.71]."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference, room
from .._design import Condition, positive
from .._design_model import DesignModel, Motion, lighter
from ..observers import (
    AbstractDifferentiator,
    DualFrictionObserver,
    FrictionEstimate,
    LevantDifferentiator,
    nominal_coefficients,
    regressors,
)

NEARLY_SATURATED = 0.5
"""Percent of duty from either end within which learning fades, so that nothing jumps."""


class AdaptiveEstimate(eqx.Module):
    """What the controller has learned, or the rates of it per second."""

    friction: FrictionEstimate
    load: Scalar
    """`dh` in N along -x."""
    drift: Scalar
    """`rh` in Pa/s."""


class Errors(eqx.Module):
    """Errors of the three steps, and what they drive."""

    position: Scalar
    """`e1` in m."""
    velocity: Scalar
    """`e2` in m/s."""
    pressure: Scalar
    """`e3` in Pa."""
    sensitivity: Scalar
    """`d theta1 / d x2` in 1/s."""
    drive: Scalar
    """`q` in m/s."""


class Moment(eqx.Module):
    """What one sample is about: the rod's motion, the chamber pressure in Pa absolute, and where the rod should be."""

    motion: Motion
    pressure: Scalar
    reference: Reference


class AdaptiveState(eqx.Module):
    """What has been learned, and what the differentiator remembers."""

    estimate: AdaptiveEstimate
    differentiator: Memory


class AdaptiveBackstepping(AbstractController):
    """Three steps of backstepping from position over velocity to pressure, while friction is learned [5.46-5.71].

    Position and pressure are measured, velocity comes from a differentiator. With the errors `e1 = x - x_ref`, `e2 = v
    + k1 e1 - x_ref'`, `e3 = p - theta1 / a1`, `a1 = A_d / m`, one signal `q` drives all that is learned: friction, by a
    [`DualFrictionObserver`][], a constant force `dh` and a constant error of the flow map `rh`. The manual's page on
    control has the law, the proof, where the print differs, and how the gains were chosen.

    **Raises:** `InputError` for gains for which `V'` may be positive.
    """

    position_gain: Scalar = parameter(140.0, symbol="k1", unit="1/s", source="5.51, value assumed")
    velocity_gain: Scalar = parameter(25.0, symbol="kappa", unit="1/s", source="5.55, value assumed")
    pressure_gain: Scalar = parameter(10.0, symbol="k3", unit="1/s", source="5.63, value assumed")
    position_weight: Scalar = parameter(64.0, symbol="w1", unit="1/s2", source="5.61, value assumed", lower=0.0)
    pressure_weight: Scalar = parameter(3.2e-10, symbol="w3", unit="m2/(s2 Pa2)", source="5.65, value assumed")
    pressure_coupling: Scalar = parameter(1.0, symbol="c", unit="1", source="assumed", lower=0.0, held=True)
    load_gain: Scalar = parameter(2200.0, symbol="gamma_d", unit="1/s2", source="assumed", lower=0.0)
    drift_gain: Scalar = parameter(150.0, symbol="gamma_r", unit="1/s2", source="assumed", lower=0.0)
    largest_load: Scalar = parameter(30.0, symbol="d_max", unit="N", source="assumed", held=True)
    largest_drift: Scalar = parameter(3e5, symbol="r_max", unit="Pa/s", source="assumed", held=True)
    forgetting_time: Scalar = parameter(0.3, symbol="T_f", unit="s", source="assumed", held=True)
    # Tuned at a velocity that the noise of the sensors reaches through the differentiator.
    reversal_width: Scalar = parameter(
        1e-2, symbol="v_w", unit="m/s", source="assumed", held=True, above=0.0, tuning_width=2e-3
    )
    model: DesignModel = eqx.field(default_factory=DesignModel)
    observer: DualFrictionObserver = eqx.field(default_factory=DualFrictionObserver)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(1.1, width=0.022))

    @classmethod
    def for_plant(
        cls, plant: AbstractPlant, model: DesignModel | None = None, **settings: Any
    ) -> "AdaptiveBackstepping":
        """On the plant's [`DesignModel`][] or another one; `w3` and `gamma_d` in inverse proportion to its mass.

        The mass, right or wrong, is a gain of the loop: the default gains are those of the printed one.
        """
        model = DesignModel.for_plant(plant) if model is None else model
        scaled = {name: lighter(model) * getattr(cls, name) for name in ("load_gain", "pressure_weight")}
        return cls(**{"model": model} | scaled | settings)

    def conditions(self) -> dict[str, Condition]:
        """[5.71] corrected, as 1 - 1/ratio, which is finite where the bound is zero."""
        lost = jnp.square((1 - self.pressure_coupling) * self._a1)
        bound = lost / (4 * self.velocity_gain * self.pressure_gain)
        signs = positive(self, "position_gain", "velocity_gain", "pressure_gain", "pressure_weight")
        return signs | {
            "pressure_weight above its bound [5.71]": Condition(
                1 - bound / self.pressure_weight,
                "pressure_weight must exceed ((1 - c) a1)^2 / (4 kappa k3) = {limit:.4g} m2/(s2 Pa2) for convergence "
                "[5.71]",
                self.pressure_weight,
                "raise it, or couple with 1",
                bound,
            )
        }

    def initial_state(self, measurement: Measurement) -> AdaptiveState:
        """Relaxed bristles, at rest, coefficients of the design model times the observer's `start`."""
        nothing = jnp.zeros_like(measurement.position)
        estimate = AdaptiveEstimate(self.observer.initial_state(self.model), nothing, nothing)
        return AdaptiveState(estimate, self.differentiator.initial_state(measurement.position))

    def update(
        self, state: AdaptiveState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[AdaptiveState, Scalar, Log]:
        """See the base class; the duty lies within 0 and 100.

        Logs `velocity` in m/s, `pressure_error` in Pa, estimated `friction` and `load` in N, and the share of each
        nominal coefficient that is estimated, `beta_0` to `beta_2`.
        """
        memory, velocity = self.differentiator.update(
            state.differentiator, measurement.position, period, reference.velocity
        )
        motion = Motion(measurement.position, velocity, measurement.ambient)
        at, now = Moment(motion, measurement.pressure, reference), state.estimate
        errors = self.errors(at, now)
        onward = self._learn(now, at, errors, period)
        duty = self._duty(at, now, errors, _per_second(now, onward, period))
        shares = now.friction.coefficients / nominal_coefficients(self.model)
        log = {
            "velocity": velocity,
            "pressure_error": errors.pressure,
            "friction": self._friction(now, velocity) - now.load,
            "load": now.load,
            **{f"beta_{index}": shares[index] for index in range(3)},
        }
        return AdaptiveState(onward, memory), duty, log

    def wanted_acceleration(self, motion: Motion, reference: Reference, estimate: AdaptiveEstimate) -> Scalar:
        """`theta1` [5.55] in m/s2: what the pressure has to take away, `a1` times the pressure that is asked for."""
        k1, k2 = self.position_gain, self._kept_damping(estimate)
        free = self._acceleration(motion, estimate, jnp.zeros_like(motion.position))
        position_error = motion.position - reference.position
        lead = (k1 + k2) * (motion.velocity - reference.velocity) + (k1 * k2 + self.position_weight) * position_error
        return free + lead - reference.acceleration

    def errors(self, at: Moment, estimate: AdaptiveEstimate) -> Errors:
        """The three errors [5.49-5.58], `d theta1 / d x2` [5.62] and `q`."""
        motion, reference = at.motion, at.reference
        position = motion.position - reference.position
        velocity = self._velocity_error(motion, reference)
        pressure_error = at.pressure - self.wanted_acceleration(motion, reference, estimate) / self._a1
        sensitivity = self._sensitivity(motion, estimate)
        drive = velocity - self.pressure_weight * pressure_error * sensitivity / self._a1
        return Errors(position, velocity, pressure_error, sensitivity, drive)

    def rates(self, motion: Motion, errors: Errors, estimate: AdaptiveEstimate) -> AdaptiveEstimate:
        """How fast everything is learned [5.47, 5.69 corrected]."""
        friction = self.observer.rates(self.model, estimate.friction, motion.velocity, errors.drive)
        return AdaptiveEstimate(friction, *self._adapting(errors))

    def pressure_rate(self, at: Moment, estimate: AdaptiveEstimate, errors: Errors, rates: AdaptiveEstimate) -> Scalar:
        """`p'_des` in Pa/s [5.63 corrected]; `rates` are those of the estimate."""
        a_h = self.model.stopped(at.motion.position, self._acceleration(at.motion, estimate, at.pressure))
        follow = self.wanted_rate(at.motion, at.reference, estimate, rates) + errors.sensitivity * a_h
        coupling = self.pressure_coupling * self._a1 / self.pressure_weight * errors.velocity
        return -self.pressure_gain * errors.pressure + coupling - estimate.drift + follow / self._a1

    def flow(self, at: Moment, estimate: AdaptiveEstimate, errors: Errors, rates: AdaptiveEstimate) -> Scalar:
        """Mass flow in kg/s into the chamber that gives `p'_des`."""
        rate = self.pressure_rate(at, estimate, errors, rates)
        return self.model.flow_for(rate, at.motion.position, at.motion.velocity, at.pressure)

    def wanted_rate(
        self, motion: Motion, reference: Reference, estimate: AdaptiveEstimate, rates: AdaptiveEstimate
    ) -> Scalar:
        """`theta2` [5.61 corrected] in m/s3: the derivative of `theta1` without what comes through the velocity."""
        k1, k2, body = self.position_gain, self._kept_damping(estimate), self.model.diaphragm
        regressor = regressors(self.model, estimate.friction.deflections, motion.velocity)
        # The velocity, which is the second one, does not move here.
        moved = regressors(self.model, rates.friction.deflections, motion.velocity).at[1].set(0.0)
        learned = jnp.sum(rates.friction.coefficients * regressor + estimate.friction.coefficients * moved)
        return (
            -learned
            + rates.friction.coefficients[1] * self._velocity_error(motion, reference)
            - rates.load / body.mass
            - (k1 + k2) * reference.acceleration
            + (k1 * k2 + self.position_weight) * (motion.velocity - reference.velocity)
            - body.stiffness / body.mass * motion.velocity
            - reference.jerk
        )

    @property
    def _a1(self) -> Scalar:
        return self.model.diaphragm.area / self.model.diaphragm.mass

    def _sensitivity(self, motion: Motion, estimate: AdaptiveEstimate) -> Scalar:
        stiffness = estimate.friction.coefficients[2] * estimate.friction.deflections[1]
        bristle = stiffness * self.model.slide_slope(motion.velocity, self.reversal_width)
        return self.position_gain + self.velocity_gain + bristle

    def _kept_damping(self, estimate: AdaptiveEstimate) -> Scalar:
        """`k2` in 1/s."""
        body = self.model.diaphragm
        return self.velocity_gain + body.damping / body.mass + estimate.friction.coefficients[1]

    def _velocity_error(self, motion: Motion, reference: Reference) -> Scalar:
        """`e2` in m/s."""
        return motion.velocity + self.position_gain * (motion.position - reference.position) - reference.velocity

    def _friction(self, estimate: AdaptiveEstimate, velocity: Scalar) -> Scalar:
        """Estimated friction and load in N along -x."""
        regressor = regressors(self.model, estimate.friction.deflections, velocity)
        return self.model.diaphragm.mass * jnp.sum(estimate.friction.coefficients * regressor) + estimate.load

    def _acceleration(self, motion: Motion, estimate: AdaptiveEstimate, pressure: Scalar) -> Scalar:
        friction = self._friction(estimate, motion.velocity)
        return self.model.acceleration(motion.position, motion.velocity, friction, pressure, motion.ambient)

    def _duty(self, at: Moment, estimate: AdaptiveEstimate, errors: Errors, rates: AdaptiveEstimate) -> Scalar:
        flow = self.flow(at, estimate, errors, rates)
        return self.model.flow_map.duty_for(flow, at.pressure, at.motion.ambient)

    def _learn(self, now: AdaptiveEstimate, at: Moment, errors: Errors, period: float) -> AdaptiveEstimate:
        """One sample later. Where the duty would saturate without learning, load and drift decay: merely held,
        they may keep the duty at its end for ever."""
        # A drive lowers the load: what would push the rod into a stop is not learned there, what pulls it off is.
        velocity = at.motion.velocity
        errors = dataclasses.replace(errors, drive=-self.model.stopped(at.motion.position, -errors.drive))
        learned = self._step(now, errors, velocity, period)
        nothing = jnp.zeros_like(errors.drive)
        idle = self._step(now, dataclasses.replace(errors, drive=nothing, pressure=nothing), velocity, period)
        duty = self._duty(at, now, errors, _per_second(now, idle, period))
        kept = 1 / (1 + period / self.forgetting_time)
        decayed = AdaptiveEstimate(idle.friction, kept * idle.load, kept * idle.drift)
        free = room(duty, NEARLY_SATURATED)
        return jax.tree.map(lambda one, other: other + free * (one - other), learned, decayed)

    def _step(self, now: AdaptiveEstimate, errors: Errors, velocity: Scalar, period: float) -> AdaptiveEstimate:
        friction = self.observer.step(self.model, now.friction, velocity, errors.drive, period)
        load, drift = self._adapting(errors)
        return AdaptiveEstimate(
            friction,
            jnp.clip(now.load + period * load, -self.largest_load, self.largest_load),
            jnp.clip(now.drift + period * drift, -self.largest_drift, self.largest_drift),
        )

    def _adapting(self, errors: Errors) -> tuple[Scalar, Scalar]:
        """Rates of load in N/s and drift in Pa/s2 [5.69 corrected]."""
        return -self.model.diaphragm.mass * self.load_gain * errors.drive, self.drift_gain * errors.pressure


def _per_second(before: AdaptiveEstimate, after: AdaptiveEstimate, period: float) -> AdaptiveEstimate:
    return jax.tree.map(lambda early, late: (late - early) / period, before, after)
