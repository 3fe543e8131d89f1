"""What disturbs a closed loop, by the place where it acts; any of them together."""

import abc
import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from ..._types import OwnState, Scalar
from ...plants import AbstractModel
from ...traces import Drive
from .._base import Measurement, Memory


class AbstractDisturbance(eqx.Module):
    """Something in a closed loop that is not as its controller takes it to be; its leaves are arrays."""


class AbstractSurroundings(AbstractDisturbance):
    """Pressures around the actuator that differ from what slow sensors show of them."""

    @abc.abstractmethod
    def felt(self, time: Float[Array, " time"], drive: Drive) -> Drive:
        """What acts on the plant, one value per sample, where the sensors show `drive`; `time` in s."""


class AbstractAlteration(AbstractDisturbance):
    """A plant that changes over time."""

    @abc.abstractmethod
    def altered(self, plant: AbstractModel, time: Scalar) -> AbstractModel:
        """The plant from a sample at `time` in s to the next."""


class AbstractDutyPath(AbstractDisturbance):
    """What happens to the duty on its way to the converter."""

    @abc.abstractmethod
    def start(self, duty: Scalar, period: float) -> Memory:
        """What it remembers before the first sample, after a duty in percent was held; `period` in s."""

    @abc.abstractmethod
    def arriving(self, memory: OwnState, duty: Scalar, period: float) -> tuple[Memory, Scalar]:
        """What it remembers next, and the duty that the converter gets until the next sample, in percent."""


class AbstractSensorFault(AbstractDisturbance):
    """Sensors that fail."""

    @abc.abstractmethod
    def start(self, measured: Measurement) -> Memory:
        """What it remembers before the first sample, which is given."""

    @abc.abstractmethod
    def shown(self, memory: OwnState, time: Scalar, measured: Measurement) -> tuple[Memory, Measurement]:
        """What it remembers next, and what is shown in place of a measurement at `time` in s."""


class Disturbed(eqx.Module):
    """All disturbances of a loop, one after the other at each place."""

    members: tuple[AbstractDisturbance, ...]

    def _of(self, kind: type) -> list[Any]:
        return [member for member in self.members if isinstance(member, kind)]

    def felt(self, time: Float[Array, " time"], drive: Drive) -> Drive:
        """What acts on the plant, at every sample."""
        return functools.reduce(lambda d, each: each.felt(time, d), self._of(AbstractSurroundings), drive)

    def altered(self, plant: AbstractModel, time: Scalar) -> AbstractModel:
        """The plant at a sample."""
        return functools.reduce(lambda p, each: each.altered(p, time), self._of(AbstractAlteration), plant)

    def start(self, measured: Measurement, duty: Scalar, period: float) -> tuple[list[Memory], list[Memory]]:
        """What sensor faults and duty paths remember before the first sample."""
        faults = [fault.start(measured) for fault in self._of(AbstractSensorFault)]
        return faults, [path.start(duty, period) for path in self._of(AbstractDutyPath)]

    def shown(
        self, memories: Sequence[Memory], time: Scalar, measured: Measurement
    ) -> tuple[list[Memory], Measurement]:
        """What the controller is given at a sample."""
        onward = []
        for fault, memory in zip(self._of(AbstractSensorFault), memories, strict=True):
            memory, measured = fault.shown(memory, time, measured)
            onward.append(memory)
        return onward, measured

    def arriving(self, memories: Sequence[Memory], duty: Scalar, period: float) -> tuple[list[Memory], Scalar]:
        """What the converter gets until the next sample."""
        onward = []
        for path, memory in zip(self._of(AbstractDutyPath), memories, strict=True):
            memory, duty = path.arriving(memory, duty, period)
            onward.append(memory)
        return onward, duty
