"""What disturbs closed loops: `[[control.disturbance]]`, `[control.reservoir]`, `[control.sensor]`; SI units."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
import pydantic

import vgtjax
from vgtjax.traces import ASSUMED_RESERVOIR

from .base import Finite, NotNegative, Positive, Share, Table

LoopSensor = Literal["position", "pressure", "reservoir", "turbine"]
"""A sensor that a controller may have."""


class AbstractLoopDisturbance(Table):
    """What disturbances of every kind share."""

    kind: str
    """Which it is."""


class CoilSupplyTable(AbstractLoopDisturbance):
    """A magnetic force that is `factor` times as strong; a list goes in straight lines from one of `times` to the next.

    With a list there are as many times as factors.
    """

    kind: Literal["coil-supply"]
    factor: Positive | Annotated[list[Positive], pydantic.Field(min_length=1)]
    """How many times as strong the magnetic force is; a list changes over time."""
    times: list[NotNegative] = []
    """s; one per factor."""

    @pydantic.model_validator(mode="after")
    def _one_time_each(self) -> "CoilSupplyTable":
        factors = len(self.factor) if isinstance(self.factor, list) else 0
        if factors != len(self.times) or factors == 1:
            raise ValueError(
                f"a coil-supply needs one factor, or a list with a time for each, but there are {len(self.times)} "
                f"times for {factors or 'one'}; give e.g. factor = [1.0, 0.8] and times = [2.0, 3.0]"
            )
        return self


class PulsationAt(AbstractLoopDisturbance):
    """A sine on the turbine's gauge pressure, a share of it, with a frequency in Hz, which its sensor does not show."""

    kind: Literal["pulsation"]
    amplitude: Share
    """Half of it from peak to peak, as a share of the gauge pressure."""
    frequency: Positive
    """Hz"""


class SensorFaultTable(AbstractLoopDisturbance):
    """What is wrong with a sensor from `begin` to `end` in s."""

    sensor: LoopSensor = "position"
    """The one that has it."""
    begin: NotNegative
    """s from which on it has it."""
    end: Annotated[float, pydantic.Field(gt=0)] = np.inf
    """s until which it has it."""

    @pydantic.model_validator(mode="after")
    def _begins_first(self) -> "SensorFaultTable":
        if not self.end > self.begin:
            raise ValueError(f"the end of a {self.kind} must be after its begin, but it is {self.end:g} s; correct it")
        return self


class StuckSensorTable(SensorFaultTable):
    """A sensor that shows its last value from `begin` to `end` in s."""

    kind: Literal["stuck-sensor"]


class LostSensorTable(SensorFaultTable):
    """A sensor that shows nothing, or a `value`, from `begin` to `end` in s."""

    kind: Literal["lost-sensor"]
    value: float = np.nan
    """What it shows meanwhile, in m or Pa; by default no number."""


LoopDisturbance = Annotated[
    CoilSupplyTable | PulsationAt | StuckSensorTable | LostSensorTable, pydantic.Field(discriminator="kind")
]

Delay = Annotated[float, pydantic.Field(ge=0, le=0.02)]
"""s by which the duty arrives late."""


class ReservoirTable(Table):
    """The vacuum: `level + drift t`, and `depth` more at each of `times`, which recovers with a time constant."""

    level: Positive = ASSUMED_RESERVOIR
    """Pa absolute at the beginning."""
    drift: Finite = 0.0
    """Pa/s"""
    times: list[NotNegative] = []
    """s at which something draws on the vacuum."""
    depth: Finite = 0.0
    """Pa by which each of them raises the pressure."""
    recovery: Positive = 0.5
    """s; time constant with which that decays."""

    def build(self) -> "vgtjax.control.AbstractSignal":
        """As a signal in Pa absolute."""
        return vgtjax.control.Draws(self.level, self.drift, np.asarray(self.times), self.depth, self.recovery)


class SensorTable(Table):
    """One sensor, where it is not as the others of its bench."""

    noise: NotNegative | None = None
    """Standard deviation of its white noise, in m or Pa."""
    offset: Finite | None = None
    """What it shows beyond the truth, in m or Pa."""
    quantum: NotNegative | None = None
    """The step between two values that it can show, in m or Pa; zero for none."""

    def changed(self, sensor: "vgtjax.control.Sensor") -> "vgtjax.control.Sensor":
        """A sensor with what is stated."""
        stated = {name: jnp.asarray(getattr(self, name)) for name in self.model_fields_set}
        return dataclasses.replace(sensor, **stated)


def build_sensors(kind: str, tables: Mapping[LoopSensor, SensorTable]) -> "vgtjax.control.Sensors":
    """Sensors of a bench or ideal ones, some of them changed."""
    sensors = vgtjax.control.Sensors.bench() if kind == "bench" else vgtjax.control.Sensors.ideal()
    changed = {name: table.changed(getattr(sensors, name)) for name, table in tables.items()}
    return dataclasses.replace(sensors, **changed)


class VariantTable(Table):
    """Closed loops beside the others, as they are but for what is stated."""

    name: Annotated[str, pydantic.Field(min_length=1)]
    """What reports call it."""
    duty_delay: Delay | None = None
    """s; that of the others if it is not given."""
    sensor: dict[LoopSensor, SensorTable] = {}


def build_disturbances(entries: Sequence[AbstractLoopDisturbance]) -> "tuple[vgtjax.control.AbstractDisturbance, ...]":
    """Disturbances of closed loops in the order in which they act, but for a duty that arrives late."""
    return tuple(_build(entry) for entry in entries)


def build_delays(delays: Mapping[str, float]) -> "dict[str, tuple[vgtjax.control.AbstractDisturbance, ...]]":
    """A duty that arrives late by so many s for every variant by its name; nothing where none does."""
    if not any(delays.values()):
        return dict.fromkeys(delays, ())
    return {name: (vgtjax.control.LateDuty(delay),) for name, delay in delays.items()}


def _build(entry: AbstractLoopDisturbance) -> "vgtjax.control.AbstractDisturbance":
    loops = vgtjax.control
    match entry:
        case CoilSupplyTable(factor=list() as factors, times=times):
            return loops.CoilSupply(loops.Ramps(np.asarray(times), np.asarray(factors)))
        case CoilSupplyTable(factor=factor):
            return loops.CoilSupply(loops.Constant(factor))
        case PulsationAt(amplitude=amplitude, frequency=frequency):
            return loops.TurbinePulsation.sine(amplitude, frequency)
        case StuckSensorTable(sensor=sensor, begin=begin, end=end):
            return loops.StuckSensor(sensor, begin, end)
        case LostSensorTable(sensor=sensor, begin=begin, end=end, value=value):
            return loops.LostSensor(sensor, begin, end, value)
    raise TypeError(f"no disturbance is built from {type(entry).__name__}")
