"""Sensors that stick or drop out."""

import dataclasses
import math
from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from .._base import Measurement
from ._disturbances import AbstractSensorFault
from ._reference import number

Channel = Literal["position", "pressure", "reservoir", "turbine"]
"""One sensor of a [`Measurement`][]."""


class StuckSensor(AbstractSensorFault):
    """From `begin` to before `end` in s, a sensor shows what it showed last."""

    channel: Channel = eqx.field(static=True)
    begin: Scalar = number()
    end: Scalar = number(default=math.inf)

    def start(self, measured: Measurement) -> Scalar:
        """What it shows first."""
        return getattr(measured, self.channel)

    def shown(self, memory: Scalar, time: Scalar, measured: Measurement) -> tuple[Scalar, Measurement]:
        """See the base class; the value that is shown is the one that is remembered."""
        stuck = (time >= self.begin) & (time < self.end)
        value = jnp.where(stuck, memory, getattr(measured, self.channel))
        return value, dataclasses.replace(measured, **{self.channel: value})


class LostSensor(AbstractSensorFault):
    """From `begin` to before `end` in s, a sensor shows `value` in its own unit: NaN, if that is not stated."""

    channel: Channel = eqx.field(static=True)
    begin: Scalar = number()
    end: Scalar = number(default=math.inf)
    value: Scalar = number(default=math.nan)

    def start(self, measured: Measurement) -> None:
        """Nothing."""

    def shown(self, memory: None, time: Scalar, measured: Measurement) -> tuple[None, Measurement]:
        """See the base class."""
        lost = (time >= self.begin) & (time < self.end)
        value = jnp.where(lost, self.value, getattr(measured, self.channel))
        return None, dataclasses.replace(measured, **{self.channel: value})
