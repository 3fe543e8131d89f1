"""Feedback linearisation with a friction observer [5.6-5.9] (Canudas de Wit, Olsson, Astrom and Lischinsky, 1995)."""

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .._errors import InputError
from ..parameters import parameter
from ..parts import AbstractVaneForce, Converter, Diaphragm, LuGre, NoVaneForce, Scalar
from ._balance import holding_duty
from ._base import AbstractController, Log, Measurement, Memory, Reference
from ._differentiator import AbstractDifferentiator, LevantDifferentiator
from ._vane_load import Motion, VaneLoad


class ObserverState(eqx.Module):
    """Observed deflection of the bristles in m, and what vanes and differentiator remember."""

    deflection: Scalar
    vanes: PyTree[Scalar]
    differentiator: Memory


class FrictionCompensation(AbstractController):
    """A PD on the position error, with the model's spring, inertia, vanes and observed friction added [5.6-5.8].

    `z' = v - sigma_0 |v| z / g(v) - k e`, `F = theta (sigma_0 z + sigma_1 z' + sigma_2 v)` with `e` position minus
    reference; the chamber pressure that gives `F_0 + F + F_v - k_p e - k_d e' + m x_ref'' + b_d x_ref' + k_sm x_ref` is
    asked for by the duty that holds it. The dot of `z'` is missing in print, and its `F_eq` is the actuating force
    itself. `F_v` is the force on the vanes as far as it is known; what is not known of it is an error until `k e` has
    taken it for friction. The differentiator is told the acceleration of the reference, so that it may be slow: noise
    of the velocity lets the observed bristles relax.

    The proof needs the transfer function [5.9] to be strictly positive real, which is checked when this is built:
    `sigma_1 (b_d + k_d) > sigma_0 m` and `k_p + k_sm > 0`. With an integrator it never is, so there is none. The
    proof ignores the lag of the chamber pressure. Gains that a study varies later are not checked again.

    **Raises:** `InputError` where [5.9] is not strictly positive real.
    """

    proportional_gain: Scalar = parameter(12000.0, symbol="k_p", unit="N/m", source="5.8, value assumed", assumed=True)
    derivative_gain: Scalar = parameter(200.0, symbol="k_d", unit="N s/m", source="5.8, value assumed", assumed=True)
    observer_gain: Scalar = parameter(10.0, symbol="k", unit="1/s", source="5.6, value assumed", assumed=True)
    load: Scalar = parameter(1.0, symbol="theta", unit="1", source="5.7", held=True)
    converter: Converter = eqx.field(default_factory=Converter)
    diaphragm: Diaphragm = eqx.field(default_factory=Diaphragm)
    friction: LuGre = eqx.field(default_factory=LuGre)
    vane_force: AbstractVaneForce = eqx.field(default_factory=NoVaneForce)
    differentiator: AbstractDifferentiator = eqx.field(default_factory=lambda: LevantDifferentiator(0.7, width=2e-3))

    def __check_init__(self) -> None:
        damping, stiffness = self.damping_margin(), self.proportional_gain + self.diaphragm.stiffness
        if isinstance(damping, jax.core.Tracer) or isinstance(stiffness, jax.core.Tracer):
            return
        if np.any(np.asarray(damping) <= 0):
            raise InputError(
                f"derivative_gain must exceed {np.max(self.derivative_gain - damping):.4g} N s/m for a strictly "
                f"positive real [5.9], but it is {np.min(self.derivative_gain):.4g}; raise it"
            )
        if np.any(np.asarray(stiffness) <= 0):
            raise InputError(
                f"proportional_gain must exceed minus the spring's {np.min(self.diaphragm.stiffness):.4g} N/m for a "
                f"strictly positive real [5.9], but it is {np.min(self.proportional_gain):.4g}; raise it"
            )

    def damping_margin(self) -> Array:
        """How far in N s/m `k_d` lies above its bound `sigma_0 m / sigma_1 - b_d`."""
        friction, diaphragm = self.friction, self.diaphragm
        bound = friction.bristle_stiffness * diaphragm.mass / friction.bristle_damping - diaphragm.damping
        return self.derivative_gain - bound

    def initial_state(self, measurement: Measurement, period: float) -> ObserverState:
        """Relaxed bristles, at rest."""
        position = measurement.position
        vanes = self.vane_force.initial_state()
        return ObserverState(jnp.zeros_like(position), vanes, self.differentiator.initial_state(position))

    def update(
        self, state: ObserverState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[ObserverState, Scalar, Log]:
        """See the base class; logs `velocity` in m/s, `friction` in N and the wanted `pressure` in Pa absolute."""
        memory, velocity = self.differentiator.update(
            state.differentiator, measurement.position, period, reference.acceleration
        )
        error, error_rate = measurement.position - reference.position, velocity - reference.velocity
        deflection, friction = self._observe(state.deflection, velocity, error, period)
        body, vane_load = self.diaphragm, VaneLoad(self.vane_force, self.diaphragm)
        motion = Motion(measurement.position, velocity, measurement.ambient, measurement.turbine)
        vanes = vane_load.after(motion, state.vanes, period)
        force = (
            body.preload
            + friction
            + vane_load(motion, vanes)
            - self.proportional_gain * error
            - self.derivative_gain * error_rate
            + body.mass * reference.acceleration
            + body.damping * reference.velocity
            + body.stiffness * reference.position
        )
        pressure = measurement.ambient - force / body.area
        duty = holding_duty(self.converter, measurement, pressure)
        log = {"velocity": velocity, "friction": friction, "pressure": pressure}
        return ObserverState(deflection, vanes, memory), duty, log

    def _observe(self, deflection: Scalar, velocity: Scalar, error: Scalar, period: float) -> tuple[Scalar, Scalar]:
        """One implicit Euler step, as fast sliding forgets within less than a sample; and the friction force in N."""
        model = self.friction
        forgetting = model.bristle_stiffness * jnp.abs(velocity) / model.stribeck(velocity)
        onward = (deflection + period * (velocity - self.observer_gain * error)) / (1 + period * forgetting)
        rate = (onward - deflection) / period
        elastic = model.bristle_stiffness * onward + model.bristle_damping * rate
        return onward, self.load * (elastic + model.viscous_damping * velocity)
