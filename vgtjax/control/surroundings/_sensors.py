"""Sensors between the plant and its controller: offset, white noise, quantisation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from ..._errors import InputError, is_traced
from ..._types import Scalar
from .._base import Measurement
from ._reference import number

POSITION_NOISE = 8e-6
"""m; standard deviation of a sample of a position sensor at 1 kHz, as we assume it."""
PRESSURE_NOISE = 60.0
"""Pa; that of its pressure sensors."""
POSITION_QUANTUM = 1e-6
"""m; step of the converter that reads the position, as we assume it."""
PRESSURE_QUANTUM = 3.1
"""Pa; that of its pressures."""


class Sensor(eqx.Module):
    """One sensor. Each sample is the truth plus `offset` and a normal deviate of deviation `noise`, then rounded.

    `noise` belongs to a sample whatever the sampling time. `quantum` is the step of the converter, rounded to the
    nearest multiple; zero rounds nothing.

    **Raises:** `InputError` for a negative `noise` or `quantum`.
    """

    noise: Scalar = number(default=0.0)
    offset: Scalar = number(default=0.0)
    quantum: Scalar = number(default=0.0)

    def __check_init__(self) -> None:
        for name in ("noise", "quantum"):
            value = getattr(self, name)
            if not is_traced(value) and np.any(np.asarray(value) < 0):
                raise InputError(f"{name} of a sensor must not be negative, but it is {value}; use zero for none")

    def __call__(self, truth: Scalar, deviate: Scalar) -> Scalar:
        """What the sensor says; `deviate` is a standard normal number."""
        return quantise(truth + self.offset + self.noise * deviate, self.quantum)


class Sensors(eqx.Module):
    """Sensors of position in m, and of chamber, reservoir and turbine pressure in Pa."""

    position: Sensor
    pressure: Sensor
    reservoir: Sensor
    turbine: Sensor = eqx.field(default_factory=Sensor)

    @classmethod
    def ideal(cls) -> "Sensors":
        """Sensors that tell the truth."""
        return cls(Sensor(), Sensor(), Sensor())

    @classmethod
    def bench(cls) -> "Sensors":
        """As a bench may have: 8 um in steps of 1 um, 60 Pa in steps of 3.1 Pa; the turbine's pressure is known."""
        pressure = Sensor(PRESSURE_NOISE, quantum=PRESSURE_QUANTUM)
        return cls(Sensor(POSITION_NOISE, quantum=POSITION_QUANTUM), pressure, pressure)

    def draw(self, key: PRNGKeyArray, samples: int) -> Float[Array, "samples 4"]:
        """Standard normal deviates for a run, from a key that is the seed."""
        return jax.random.normal(key, (samples, 4), dtype=self.position.noise.dtype)

    def __call__(self, truth: Measurement, deviates: Float[Array, " 4"]) -> Measurement:
        """What the sensors say at one sample. The atmosphere is known."""
        return Measurement(
            self.position(truth.position, deviates[0]),
            self.pressure(truth.pressure, deviates[1]),
            self.reservoir(truth.reservoir, deviates[2]),
            truth.ambient,
            self.turbine(truth.turbine, deviates[3]),
        )


@jax.custom_jvp
def quantise(value: Scalar, quantum: Scalar) -> Scalar:
    """The multiple of `quantum` nearest to `value`; `value` itself where `quantum` is zero.

    Its derivative is that of `value`, as if nothing were rounded ("straight through"): the true one is zero almost
    everywhere, and would hide the plant from a controller that is tuned.
    """
    coarse = quantum > 0
    step = jnp.where(coarse, quantum, 1.0)
    return jnp.where(coarse, jnp.round(value / step) * step, value)


@quantise.defjvp
def _straight_through(primals, tangents):
    return quantise(*primals), tangents[0]
