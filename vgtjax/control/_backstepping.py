"""Backstepping from the position alone, with observed pressure and friction [5.22-5.43]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..parameters import parameter
from ..parts import Scalar
from ._base import FULL_DUTY, AbstractController, Log, Measurement, Memory, Reference, saturate
from ._differentiator import AbstractDifferentiator, LevantDifferentiator
from ._pressure_observer import ObservedState, PressureObserver
from ._vane_load import Motion

NEAR_LIMIT = 5.0
"""%; the duty's distance from a limit within which the rod counts as following the reference the less."""


def _differentiator() -> AbstractDifferentiator:
    return LevantDifferentiator(1.0, width=2e-3)


class BacksteppingState(eqx.Module):
    """What was observed at the last sample, what the differentiator remembers, and the duty since then in percent."""

    observed: ObservedState
    differentiator: Memory
    duty: Scalar


class Backstepping(AbstractController):
    """Backstepping on the [`DesignModel`][], with a [`PressureObserver`][]; only the position is measured [5.22-5.35].

    The steps that the print has lost [5.24-5.32], with `e1 = x - x_ref` and hats for what is observed:

    1. `s1 = e1' + lambda e1` [5.22], so `m s1' = (p_atm - p) A_d - F_0 - k_sm x - B v - theta S z - m x_ref'' +
       lambda m (v - x_ref')` [5.23, corrected].
    2. Pressure is the virtual control. The wanted one `p*` would make `s1' = -K_d s1` if the bristles were as observed:

           A_d p* = p_atm A_d - F_0 - k_sm x - B v - theta S zh - F_v - m x_ref'' + lambda m (v - x_ref') + m K_d s1

    3. With `s2 = p - p*`, of which `sh2 = ph - p*` is known, and errors `e3 = z - zh`, `e4 = p - ph` of the observer,
       `s1' = -K_d s1 - (A_d/m) s2 - (theta S/m) e3`.
    4. `p*'` needs the acceleration, observed as `ah = ((p_atm - ph) A_d - F_0 - k_sm x - B v - theta S zh - F_v)/m`,
       with which `s1' = ah - x_ref'' + lambda (v - x_ref')`:

           A_d p*' = -(k_sm v + (B - lambda m + theta S_v zh) ah + theta S zh' + F_v' + m x_ref''' + lambda m x_ref''
                       - m K_d s1')

    5. `m_dot = V/(n R T) (-K_U sh2 + A_d/(m w) s1 + p*') - A_d v ph/(R T)` [5.34]; the duty is that at which the flow
       map gives it at `ph`, on the branch where flow falls with duty. The print takes the other root of [5.10] and
       lacks the term with `w`, which cancels the mixed one in `V_C`.

    **Stability.** `V_C = s1^2/2 + w s2^2/2`: `w` makes one unit of two, where [5.36] adds m2/s2 and Pa2. With
    `V = V_C + K V_O` any `lambda, K_d, K_U > 0` will do and `K` only has to be large enough for the proof; the bound
    of [5.40] on `K_d` comes from its units. The proof is in continuous time, without saturation, end stops, noise or
    lag of the plunger, and takes the velocity as known and `reversal_width` as zero: it smooths the jump of `S_v`,
    which noise would throw into the duty at every reversal. On a stop, `ah` does not point into it.

    **Noise.** The plunger answers a noisy duty as if it were another one, since its orifices open one way, and noise
    of the velocity lets the observed bristles relax at rest. So the differentiator is told the reference's acceleration
    and may be slow, and the law takes its position, not the sensor's.

    **Gains.** `p*` cancels friction by a positive feedback of velocity, `B - m (lambda + K_d)` of it, and a plunger
    that lags makes that unstable: the full actuator swings by millimetres with `lambda, K_d, K_U` of 20, 40, 60 1/s.
    With `K_d` near `B/m`, 1000 1/s, the measured velocity drops out of that term, as if friction were compensated at
    the wanted velocity. What the lag bears is the damping `m K_d`, some 750 N s/m: a model with five times the mass
    wants a fifth of `K_d` and of `w`. The defaults are tuned on the printed actuator with the bench's sensors and the
    fitted map of [`SteadyPlungerFlow`][]; with a [`PolynomialFlow`][], the default map, errors are a tenth of a
    millimetre and some kilopascals. With an `exponent` of 1.3 errors of the full actuator, whose air keeps its heat,
    are a seventh along a sine of 2 rad/s. An error of the spring or the preload is taken for pressure or friction, and
    leaves an error of the position, since there is no integrator.

    The observer starts at the pressure of the atmosphere with relaxed bristles.
    """

    position_gain: Scalar = parameter(45.0, symbol="lambda", unit="1/s", source="5.22, value assumed", assumed=True)
    velocity_gain: Scalar = parameter(1200.0, symbol="K_d", unit="1/s", source="5.34, value assumed", assumed=True)
    pressure_gain: Scalar = parameter(400.0, symbol="K_U", unit="1/s", source="5.34, value assumed", assumed=True)
    pressure_weight: Scalar = parameter(
        2.5e-7, symbol="w", unit="m2/(s2 Pa2)", source="5.36, value assumed", assumed=True
    )
    reversal_width: Scalar = parameter(3e-3, symbol="v_w", unit="m/s", source="assumed", assumed=True, held=True)
    observer: PressureObserver = eqx.field(default_factory=PressureObserver)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=_differentiator)

    def initial_state(self, measurement: Measurement, period: float) -> BacksteppingState:
        """At rest, with the chamber at atmosphere."""
        observed = self.observer.initial_state(measurement.ambient)
        memory = self.differentiator.initial_state(measurement.position)
        return BacksteppingState(observed, memory, jnp.zeros_like(measurement.position))

    def update(
        self, state: BacksteppingState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[BacksteppingState, Scalar, Log]:
        """See the base class.

        Logs `velocity` in m/s, the observed `pressure` in Pa absolute, `deflection` in m and `friction` in N, and the
        `wanted_pressure` in Pa absolute.
        """
        # While the duty saturates the rod does not follow.
        follows = jnp.clip(jnp.minimum(state.duty, FULL_DUTY - state.duty) / NEAR_LIMIT, 0.0, 1.0)
        expected = follows * reference.acceleration
        memory, velocity = self.differentiator.update(state.differentiator, measurement.position, period, expected)
        position = self.differentiator.value(memory, period)
        motion = Motion(position, velocity, measurement.ambient, measurement.turbine)
        observed, rate = self.observer.step(state.observed, motion, state.duty, period)
        wanted = self.wanted_pressure(motion, observed, reference)
        duty = self._duty(motion, observed, rate, wanted, reference)
        log = {
            "velocity": velocity,
            "pressure": observed.pressure,
            "deflection": observed.deflection,
            "friction": self.observer.model.friction_force(velocity, observed.deflection),
            "wanted_pressure": wanted,
        }
        return BacksteppingState(observed, memory, saturate(duty)), duty, log

    def surface(self, motion: Motion, reference: Reference) -> Array:
        """`s1` in m/s [5.22]."""
        error = motion.position - reference.position
        return motion.velocity - reference.velocity + self.position_gain * error

    def wanted_pressure(self, motion: Motion, observed: ObservedState, reference: Reference) -> Array:
        """The virtual control `p*` in Pa absolute, which the observed pressure takes no part in."""
        body = self.observer.model.diaphragm
        # The drive at which nothing accelerates, less what the error wants.
        balance = self._acceleration(motion, observed, jnp.zeros_like(observed.pressure))
        error_rate = motion.velocity - reference.velocity
        demand = (
            self.position_gain * error_rate
            + self.velocity_gain * self.surface(motion, reference)
            - reference.acceleration
        )
        return body.mass / body.area * (balance + demand)

    def wanted_pressure_rate(
        self, motion: Motion, observed: ObservedState, deflection_rate: Scalar, reference: Reference
    ) -> Array:
        """`p*'` in Pa/s along the observed motion; `deflection_rate` is `zh'` in m/s."""
        model, body, velocity = self.observer.model, self.observer.model.diaphragm, motion.velocity
        acceleration = model.stopped(motion.position, self._acceleration(motion, observed, observed.pressure))
        bristles = model.stiffness_slope(velocity, self.reversal_width) * observed.deflection
        braking = model.damping + model.load * bristles
        surface_rate = acceleration - reference.acceleration + self.position_gain * (velocity - reference.velocity)
        force_rate = (
            body.stiffness * velocity
            + (braking - self.position_gain * body.mass) * acceleration
            + model.load * model.stiffness(velocity) * deflection_rate
            + model.vane_load.rate(motion, observed.vanes)
            + body.mass * (reference.jerk + self.position_gain * reference.acceleration)
            - body.mass * self.velocity_gain * surface_rate
        )
        return -force_rate / body.area

    def _acceleration(self, motion: Motion, observed: ObservedState, pressure: Scalar) -> Scalar:
        """Of the rod in m/s2 at a pressure in Pa absolute, with friction and vanes as observed."""
        model = self.observer.model
        friction = model.friction_force(motion.velocity, observed.deflection)
        resistance = friction + model.vane_load(motion, observed.vanes)
        return model.acceleration(motion.position, motion.velocity, resistance, pressure, motion.ambient)

    def _duty(
        self, motion: Motion, observed: ObservedState, deflection_rate: Scalar, wanted: Scalar, reference: Reference
    ) -> Scalar:
        model, body = self.observer.model, self.observer.model.diaphragm
        wanted_rate = self.wanted_pressure_rate(motion, observed, deflection_rate, reference)
        coupling = body.area / (body.mass * self.pressure_weight) * self.surface(motion, reference)
        rate = wanted_rate + coupling - self.pressure_gain * (observed.pressure - wanted)
        flow = model.flow_for(rate, motion.position, motion.velocity, observed.pressure)
        return model.flow_map.duty_for(flow, observed.pressure, motion.ambient)
