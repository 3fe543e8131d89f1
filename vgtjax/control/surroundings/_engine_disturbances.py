"""What an engine does to a closed loop: its pulsation, its electrical supply, and a duty that arrives late."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._errors import InputError, is_traced
from ..._types import Scalar
from ...exhaust import PressurePulsation
from ...parts.magnetic_force import ScaledForce
from ...plants import AbstractModel, require_converter
from ...traces import STANDARD_ATMOSPHERE, Drive, Ramp
from ._disturbances import AbstractAlteration, AbstractDutyPath, AbstractSurroundings
from ._recurring import Periodic
from ._reference import AbstractSignal, Constant, Sine, number

TURN = 2 * np.pi
COPPER = 3.93e-3
"""1/K; by which part copper's resistance rises from 20 degC on (IEC 60028)."""
CYCLE_SECONDS = 120.0
"""s; a cycle of a four-stroke engine at 1 rpm."""


class TurbinePulsation(AbstractSurroundings):
    """Turbine pressure that pulsates about what its slow sensor shows, by `share` of the gauge pressure over time.

    It is taken at the samples, and linear between them: a period of 1 ms has fifteen in a firing interval of 67 Hz.
    """

    share: AbstractSignal

    @classmethod
    def sine(cls, share: float | Scalar, frequency: float | Scalar) -> "TurbinePulsation":
        """A sine with an amplitude that is a share of the gauge pressure, and a frequency in Hz."""
        return cls(Sine(share, TURN * frequency))

    @classmethod
    def of(cls, pulsation: PressurePulsation, atmosphere: float = STANDARD_ATMOSPHERE) -> "TurbinePulsation":
        """That of an engine, in an atmosphere in Pa.

        **Raises:** as [`PressurePulsation.shape`][].
        """
        return cls(Periodic(pulsation.shape(atmosphere), CYCLE_SECONDS / pulsation.engine_speed))

    def felt(self, time: Float[Array, " time"], drive: Drive) -> Drive:
        """See the base class."""
        slow = drive.turbine.start
        values = slow * (1 + jax.vmap(self.share)(time))
        rates = jnp.diff(values, append=values[-1:]) / jnp.where(drive.duration > 0, drive.duration, 1.0)
        return dataclasses.replace(drive, turbine=Ramp(values, rates))


class CoilSupply(AbstractAlteration):
    """A magnetic force that is `factor` times as strong over time, as the coil's voltage and temperature have it.

    The plant must have a converter.
    """

    factor: AbstractSignal

    @classmethod
    def constant(cls, factor: float | Scalar) -> "CoilSupply":
        """The same factor at all times."""
        return cls(Constant(factor))

    @classmethod
    def for_coil(cls, voltage: float, rated_voltage: float, warmer: float = 0.0) -> "CoilSupply":
        """A coil at `voltage` V, `warmer` K above the 20 degC at which its force was found with `rated_voltage` V.

        The mean current is that of the voltage over copper's resistance, and the force goes with its square, as long
        as the iron does not saturate: near saturation it changes less.

        **Raises:** `InputError` for a voltage that is not above zero, or a coil so cold that it has no resistance.
        """
        resistance = 1 + COPPER * warmer
        if not (voltage > 0 and rated_voltage > 0 and resistance > 0):
            raise InputError(
                f"a coil needs voltages above zero and a resistance, but has {voltage:g} V for {rated_voltage:g} V and "
                f"is {warmer:g} K warmer; give V, V and K"
            )
        return cls.constant((voltage / rated_voltage / resistance) ** 2)

    def altered(self, plant: AbstractModel, time: Scalar) -> AbstractModel:
        """See the base class.

        **Raises:** `InputError` for a plant without a converter.
        """
        whole: Any = plant
        magnet = ScaledForce(require_converter(plant, "a supply of the coil").magnetic_force, self.factor(time))
        return eqx.tree_at(lambda p: p.air_path.converter.magnetic_force, whole, magnet)


class LateDuty(AbstractDutyPath):
    """A duty that arrives `delay` seconds late, at most `longest`.

    Where the delay is no multiple of the period, the two duties that share an interval count by their parts of it.

    **Raises:** `InputError` for a delay that is negative or longer than `longest`.
    """

    delay: Scalar = number()
    longest: float = eqx.field(static=True, default=0.02)

    def __check_init__(self) -> None:
        if not is_traced(self.delay) and not np.all((np.asarray(self.delay) >= 0) & (self.delay <= self.longest)):
            raise InputError(
                f"the delay of a duty must lie between 0 and longest = {self.longest:g} s, but it is {self.delay} s; "
                "raise longest"
            )

    def start(self, duty: Scalar, period: float) -> Float[Array, " samples"]:
        """Earlier duties, the latest first."""
        return jnp.full(int(np.ceil(self.longest / period)) + 2, duty)

    def arriving(
        self, memory: Float[Array, " samples"], duty: Scalar, period: float
    ) -> tuple[Float[Array, " samples"], Scalar]:
        """See the base class."""
        duties = jnp.concatenate([duty[None], memory[:-1]])
        late = self.delay / period
        # Far less than a sample, so that a delay of whole periods is no part of one by rounding.
        whole = jnp.floor(late + 1e-6)
        part = jnp.where(late >= whole, late - whole, 0.0)  # `maximum` would halve the derivative of whole periods
        index = whole.astype(int)
        return duties, (1 - part) * duties[index] + part * duties[index + 1]
