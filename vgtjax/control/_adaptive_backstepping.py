"""Adaptive backstepping with a dual friction observer [5.46-5.71]."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import InputError
from ..parameters import parameter
from ..parts import Scalar
from ._base import FULL_DUTY, AbstractController, Log, Measurement, Memory, Reference
from ._design_model import DesignModel
from ._differentiator import AbstractDifferentiator, LevantDifferentiator
from ._friction_observer import DualFrictionObserver, FrictionEstimate, nominal_coefficients, regressors, slide_slope

NEARLY_SATURATED = 0.5
"""Percent of duty from either end within which learning fades, so that nothing jumps."""


class AdaptiveEstimate(eqx.Module):
    """What the controller has learned, or the rates of it a second."""

    friction: FrictionEstimate
    load: Scalar
    """`dh` in N along -x."""
    drift: Scalar
    """`rh` in Pa/s."""


class Motion(eqx.Module):
    """Where the design model is at one sample."""

    position: Scalar
    velocity: Scalar
    pressure: Scalar
    ambient: Scalar


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


class AdaptiveState(eqx.Module):
    """What has been learned, and what the differentiator remembers."""

    estimate: AdaptiveEstimate
    differentiator: Memory


class AdaptiveBackstepping(AbstractController):
    """Three steps of backstepping from position over velocity to pressure, while friction is learned [5.46-5.71].

    Position and pressure are measured, velocity comes from a differentiator. With the errors

        e1 = x - x_ref;   e2 = v + k1 e1 - x_ref';   e3 = p - theta1 / a1,   a1 = A_d / m

    and the estimate `F/m = bh0 zh0 + bh1 v - bh2 h zh1` of a [`DualFrictionObserver`][], the pressure that is asked for
    and the rate of pressure that leads there are

        theta1 = a(p = 0, F) - dh/m + (k1 + k2)(v - x_ref') + (k1 k2 + w1) e1 - x_ref'';   k2 = kappa + b_d/m + bh1
        p'_des = -k3 e3 + c (a1/w3) e2 - rh + (theta2 + (d theta1/dv) a_h) / a1

    `a(p, F)` is the acceleration of the design model, `a_h` that with the measured pressure and `dh`, and `theta2` all
    of `theta1'` that does not come through `v`. The flow that gives `p'_des` is asked of the flow map by its inverse,
    not of (5.63), which divides by what may vanish. One signal drives all that is learned:

        q = e2 - w3 (d theta1/dv) e3 / a1;      dh' = -m gamma_d q;   rh' = gamma_r e3

    **Why it converges.** For the design model with `bt = beta - bh`, `zt = z - zh`, constant unknown `d`, `r`, and

        V = w1 e1^2/2 + e2^2/2 + w3 e3^2/2 + sum bt_i^2/(2 gamma_i) + beta0 zt0^2/(2 iota0) + beta2 zt1^2/(2 iota1)
            + (d - dh)^2/(2 m^2 gamma_d) + w3 (r - rh)^2/(2 gamma_r)
        V' = -w1 k1 e1^2 - k2 e2^2 - w3 k3 e3^2 - (1 - c) a1 e2 e3 - sigma_0 h (beta0 zt0^2/iota0 + beta2 zt1^2/iota1)

    exactly. With `c = 1` any positive gains do; otherwise `4 kappa k3 w3 > ((1 - c) a1)^2`. With `w1 = 0` any small
    weight on `e1` serves in `V`. `c = 0` and `w1 = 0` is (5.55) and (5.63) as printed but for `k2`, `w1 = 1` is (5.61).
    The printed (5.71) has the sign of `a1` wrong twice: with Young's inequality and unit weights, `k2 > (1 + a1)/2` and
    `k3 > a1/2`. As the reference moves, errors vanish by Barbalat's lemma, not LaSalle's; what is learned need not
    become true.

    **Why `k2` is learned.** A constant `k2`, as in the thesis, cancels the damping `b_d/m + bh1` and puts `k1 + k2` in
    its place. The difference is `d theta1/dv`, by which the acceleration acts on the pressure, and through a plunger
    that lags only some of it is borne, neither too little nor too much. But `bh1` drifts with all that the design model
    leaves out, and then a rod of 3 kg swings by millimetres, after a reversal or after minutes. With the damping kept,
    `d theta1/dv` is `k1 + kappa` but for the bristle's part, whatever `bh1` is. `k2' = bh1'` adds `bh1' e2` to
    `theta2`.

    Not in the thesis are `dh`, a constant force that nobody knows of (gas on the vanes, a wrong spring), and `rh`, a
    constant error of the flow map: without `rh` it leaves `e3`, and with it `e2 = w3 (d theta1/dv) e3 / a1`, where `q`
    rests. With gains of zero they are zero, as in the thesis. Both are held within `largest_load` and `largest_drift`.
    The vane force of the design model is left to `dh` too.

    End stops and limits of the duty are not in the design model. A stop takes up what drives the rod into it: that part
    of `a_h` and of what `q` would teach is left out, so that the rod comes off in time. Where the duty saturates,
    nothing is learned, and load and drift are forgotten; within `NEARLY_SATURATED` of its ends in part. Pressure is in
    Pa: `w3` far below one, as in the default, keeps `q` a velocity (in print (5.65) adds Pa2 to m2/s2).

    **Velocity.** What is fast reaches the duty through `a_h`, from the measured pressure. So the differentiator may be
    slow, which keeps noise out; it is told the reference's acceleration. It has to be linear, as the default is: one
    that bounds the slope's rate falls behind as soon as the rod swings, and then keeps it swinging. The bristle's part
    of `d theta1/dv` holds the sign of the velocity, which noise would toss at every reversal: a fraction that passes
    zero within `reversal_width` stands for it. The proof wants that small.

    **Gains.** The defaults come from a search over twenty fitted units, which move 0.56 to 3 kg, under the noise of the
    bench, all on the default design model, and from friction coefficients anywhere in the observer's interval. A larger
    `gamma_d` follows the force on the vanes faster, but from 1500 1/s2 on units swing that learned far too much
    damping. The mass of the design model, right or wrong, is a gain of the loop: with another one, `w3` and `gamma_d`
    have to change in inverse proportion to it.

    **Raises:** `InputError` for gains for which `V'` may be positive. Gains that a study varies later are not checked
    again.
    """

    position_gain: Scalar = parameter(150.0, symbol="k1", unit="1/s", source="5.51, value assumed", assumed=True)
    velocity_gain: Scalar = parameter(300.0, symbol="kappa", unit="1/s", source="5.55, value assumed", assumed=True)
    pressure_gain: Scalar = parameter(27.0, symbol="k3", unit="1/s", source="5.63, value assumed", assumed=True)
    position_weight: Scalar = parameter(
        64.0, symbol="w1", unit="1/s2", source="5.61, value assumed", assumed=True, positive=False, lower=0.0
    )
    pressure_weight: Scalar = parameter(
        2e-10, symbol="w3", unit="m2/(s2 Pa2)", source="5.65, value assumed", assumed=True
    )
    pressure_coupling: Scalar = parameter(
        1.0, symbol="c", unit="1", source="assumed", assumed=True, positive=False, lower=0.0, held=True
    )
    load_gain: Scalar = parameter(
        1200.0, symbol="gamma_d", unit="1/s2", source="assumed", assumed=True, positive=False, lower=0.0
    )
    drift_gain: Scalar = parameter(
        270.0, symbol="gamma_r", unit="1/s2", source="assumed", assumed=True, positive=False, lower=0.0
    )
    largest_load: Scalar = parameter(30.0, symbol="d_max", unit="N", source="assumed", assumed=True, held=True)
    largest_drift: Scalar = parameter(3e5, symbol="r_max", unit="Pa/s", source="assumed", assumed=True, held=True)
    forgetting_time: Scalar = parameter(0.1, symbol="T_f", unit="s", source="assumed", assumed=True, held=True)
    reversal_width: Scalar = parameter(1e-2, symbol="v_w", unit="m/s", source="assumed", assumed=True, held=True)
    model: DesignModel = eqx.field(default_factory=DesignModel)
    observer: DualFrictionObserver = eqx.field(default_factory=DualFrictionObserver)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(8.0, width=0.022))

    def __check_init__(self) -> None:
        gains = {name: getattr(self, name) for name in _POSITIVE + _NOT_NEGATIVE}
        area, mass = self.model.diaphragm.area, self.model.diaphragm.mass
        values = (*gains.values(), self.pressure_coupling, area, mass)
        if any(isinstance(value, jax.core.Tracer) for value in values):
            return
        known = {name: np.asarray(value) for name, value in gains.items()}
        for name, value in known.items():
            if np.any(value < 0) or (name in _POSITIVE and np.any(value == 0)):
                rule = "positive" if name in _POSITIVE else "zero or positive"
                raise InputError(f"{name} must be {rule} for convergence [5.71], but it is {value}; raise it")
        lost = ((1 - np.asarray(self.pressure_coupling)) * np.asarray(area) / np.asarray(mass)) ** 2
        least = lost / (4 * known["velocity_gain"] * known["pressure_gain"])
        if np.any(known["pressure_weight"] <= least):
            raise InputError(
                f"pressure_weight must exceed ((1 - c) a1)^2 / (4 kappa k3) = {np.max(least):.4g} m2/(s2 Pa2) for "
                f"convergence [5.71], but it is {np.min(known['pressure_weight']):.4g}; raise it, or couple with 1"
            )

    def initial_state(self, measurement: Measurement, period: float) -> AdaptiveState:
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
            state.differentiator, measurement.position, period, reference.acceleration
        )
        motion = Motion(measurement.position, velocity, measurement.pressure, measurement.ambient)
        now = state.estimate
        errors = self.errors(motion, reference, now)
        onward = self._learn(now, motion, reference, errors, period)
        duty = self._duty(motion, reference, now, errors, _per_second(now, onward, period))
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
        free = self._acceleration(motion, estimate, jnp.zeros_like(motion.pressure))
        position_error = motion.position - reference.position
        lead = (k1 + k2) * (motion.velocity - reference.velocity) + (k1 * k2 + self.position_weight) * position_error
        return free + lead - reference.acceleration

    def errors(self, motion: Motion, reference: Reference, estimate: AdaptiveEstimate) -> Errors:
        """The three errors [5.49-5.58], `d theta1 / d x2` [5.62] and `q`."""
        position = motion.position - reference.position
        velocity = self._velocity_error(motion, reference)
        pressure = motion.pressure - self.wanted_acceleration(motion, reference, estimate) / self._a1
        sensitivity = self._sensitivity(motion, estimate)
        drive = velocity - self.pressure_weight * pressure * sensitivity / self._a1
        return Errors(position, velocity, pressure, sensitivity, drive)

    def rates(self, motion: Motion, errors: Errors, estimate: AdaptiveEstimate) -> AdaptiveEstimate:
        """How fast everything is learned [5.47, 5.69 corrected]."""
        friction = self.observer.rates(self.model, estimate.friction, motion.velocity, errors.drive)
        load = -self.model.diaphragm.mass * self.load_gain * errors.drive
        return AdaptiveEstimate(friction, load, self.drift_gain * errors.pressure)

    def pressure_rate(
        self,
        motion: Motion,
        reference: Reference,
        estimate: AdaptiveEstimate,
        errors: Errors,
        rates: AdaptiveEstimate,
    ) -> Scalar:
        """`p'_des` in Pa/s [5.63 corrected]; `rates` are those of the estimate."""
        a_h = self.model.stopped(motion.position, self._acceleration(motion, estimate, motion.pressure))
        follow = self.wanted_rate(motion, reference, estimate, rates) + errors.sensitivity * a_h
        coupling = self.pressure_coupling * self._a1 / self.pressure_weight * errors.velocity
        return -self.pressure_gain * errors.pressure + coupling - estimate.drift + follow / self._a1

    def flow(
        self,
        motion: Motion,
        reference: Reference,
        estimate: AdaptiveEstimate,
        errors: Errors,
        rates: AdaptiveEstimate,
    ) -> Scalar:
        """Mass flow in kg/s into the chamber that gives `p'_des`."""
        rate = self.pressure_rate(motion, reference, estimate, errors, rates)
        return self.model.flow_for(rate, motion.position, motion.velocity, motion.pressure)

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
        bristle = stiffness * slide_slope(self.model, motion.velocity, self.reversal_width)
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

    def _duty(
        self,
        motion: Motion,
        reference: Reference,
        estimate: AdaptiveEstimate,
        errors: Errors,
        rates: AdaptiveEstimate,
    ) -> Scalar:
        flow = self.flow(motion, reference, estimate, errors, rates)
        return self.model.flow_map.duty_for(flow, motion.pressure, motion.ambient)

    def _learn(
        self, now: AdaptiveEstimate, motion: Motion, reference: Reference, errors: Errors, period: float
    ) -> AdaptiveEstimate:
        """One sample later. Where the duty would saturate without learning, load and drift are forgotten: merely held,
        they may keep the duty at its end for ever."""
        # A drive lowers the load: what would push the rod into a stop is not learned there, what pulls it off is.
        errors = dataclasses.replace(errors, drive=-self.model.stopped(motion.position, -errors.drive))
        learned = self._step(now, errors, motion.velocity, period)
        nothing = jnp.zeros_like(errors.drive)
        idle = self._step(now, dataclasses.replace(errors, drive=nothing, pressure=nothing), motion.velocity, period)
        duty = self._duty(motion, reference, now, errors, _per_second(now, idle, period))
        kept = 1 / (1 + period / self.forgetting_time)
        forgotten = AdaptiveEstimate(idle.friction, kept * idle.load, kept * idle.drift)
        free = jnp.clip(jnp.minimum(duty, FULL_DUTY - duty) / NEARLY_SATURATED, 0.0, 1.0)
        return jax.tree.map(lambda one, other: other + free * (one - other), learned, forgotten)

    def _step(self, now: AdaptiveEstimate, errors: Errors, velocity: Scalar, period: float) -> AdaptiveEstimate:
        friction = self.observer.step(self.model, now.friction, velocity, errors.drive, period)
        load = now.load - period * self.model.diaphragm.mass * self.load_gain * errors.drive
        drift = now.drift + period * self.drift_gain * errors.pressure
        return AdaptiveEstimate(
            friction,
            jnp.clip(load, -self.largest_load, self.largest_load),
            jnp.clip(drift, -self.largest_drift, self.largest_drift),
        )


_POSITIVE = ("position_gain", "velocity_gain", "pressure_gain", "pressure_weight")
_NOT_NEGATIVE = ("position_weight", "load_gain", "drift_gain")


def _per_second(before: AdaptiveEstimate, after: AdaptiveEstimate, period: float) -> AdaptiveEstimate:
    return jax.tree.map(lambda early, late: (late - early) / period, before, after)
