"""What a closed loop is put through."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from ..._types import Scalar
from ...traces import ASSUMED_RESERVOIR, Drive, Ramp, Start
from .._base import Reference
from ._disturbances import AbstractDisturbance
from ._reference import AbstractSignal, Constant, number, reference_at
from ._sensors import Sensors


def at_rest() -> Start:
    """The start of a run with the chamber at atmosphere and the rod on its open stop."""
    nothing = np.asarray(0.0)
    return Start(np.asarray(True), nothing, np.asarray(False), nothing, np.asarray(False))


def balanced_at(position: float) -> Start:
    """The start of a run with the rod at rest at a position in m, in static balance with the chamber."""
    nothing = np.asarray(0.0)
    return Start(np.asarray(False), nothing, np.asarray(False), np.asarray(position, float), np.asarray(True))


class Scenario(eqx.Module):
    """Reference, surroundings, sensors and start of one run; all leaves are arrays, so scenarios can be batched.

    `reference` in m: a signal, or a [`Reference`][] with one value per sample. `turbine` in Pa gauge and `reservoir` in
    Pa absolute are taken at the samples, and linear between them. `duty_before` in percent was held before the first
    sample: it decides where the plunger rests then. `ambient_shift` in Pa as in [`Drive`][]. `key` is the seed of the
    noise. `disturbances` act one after the other, e.g. a [`LateDuty`][] and a [`StuckSensor`][].
    """

    reference: AbstractSignal | Reference
    turbine: AbstractSignal = eqx.field(default_factory=lambda: Constant(0.0))
    reservoir: AbstractSignal = eqx.field(default_factory=lambda: Constant(ASSUMED_RESERVOIR))
    sensors: Sensors = eqx.field(default_factory=Sensors.ideal)
    start: Start = eqx.field(default_factory=at_rest)
    duty_before: Scalar = number(default=0.0)
    ambient_shift: Scalar = number(default=0.0)
    key: PRNGKeyArray = eqx.field(default_factory=lambda: jax.random.key(0))
    disturbances: tuple[AbstractDisturbance, ...] = ()

    def references(self, time: Float[Array, " time"]) -> Reference:
        """The reference at every sample."""
        signal = self.reference
        if isinstance(signal, Reference):
            return signal
        return jax.vmap(lambda t: reference_at(signal, t))(time)

    def drive(self, time: Float[Array, " time"], period: float) -> Drive:
        """Inputs over the interval that each sample begins but for the duty; the last interval has no length."""
        last = jnp.arange(len(time)) == len(time) - 1

        def ramp(signal: AbstractSignal) -> Ramp:
            values = jax.vmap(signal)(time)
            return Ramp(values, jnp.diff(values, append=values[-1:]) / period)

        return Drive(
            duration=jnp.where(last, 0.0, jnp.full_like(time, period)),
            ambient_shift=jnp.full_like(time, 1.0) * self.ambient_shift,
            turbine=ramp(self.turbine),
            reservoir=ramp(self.reservoir),
        )
