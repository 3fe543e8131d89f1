"""The pneumatic half of a plant: from the duty to the pressure in the chamber [2.58, without 2.34]."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .._types import OwnState, StateLeaf, Values
from ..parts import (
    AbstractChamber,
    AbstractLine,
    AdiabaticChamber,
    Air,
    Converter,
    ConverterState,
    Flow,
    GasState,
    NoLine,
)
from ..traces import Drive
from ._base import AbstractModel, Inner


def ambient_pressure(air: Air, drive: Drive) -> Values:
    """Pressure of the atmosphere in Pa, as a trace has it."""
    return air.pressure + drive.ambient_shift


def reservoir_pressure(time: Values, drive: Drive) -> Values:
    """Pressure of the reservoir in Pa absolute, `time` seconds after the start of the interval."""
    assert drive.reservoir is not None, "a trace without one gets the assumed pressure"
    return drive.reservoir(time)


class AbstractAirPath(eqx.Module):
    """What a plant needs of its pneumatic half; its state is a PyTree of scalars that it alone understands.

    `air` is that around the plant, `drive` the interval, `time` in s counts from its start; `displaced` in m3 and
    `displacement_rate` in m3/s are the volume that the diaphragm has swept.
    """

    chamber: eqx.AbstractVar[AbstractChamber]

    @abc.abstractmethod
    def working_pressure(self, air: Air, drive: Drive) -> Values:
        """Chamber pressure in Pa absolute at which nothing flows under the duty of `drive` [2.8]."""

    @abc.abstractmethod
    def start(self, air: Air, pressure: Values, drive: Drive) -> PyTree[StateLeaf]:
        """State at rest at a chamber pressure in Pa absolute."""

    @abc.abstractmethod
    def pressure(self, state: OwnState) -> Values:
        """Chamber pressure in Pa absolute."""

    @abc.abstractmethod
    def rates(
        self, air: Air, time: Values, state: OwnState, drive: Drive, displaced: Values, displacement_rate: Values
    ) -> PyTree[StateLeaf]:
        """Time derivative of the state."""

    @abc.abstractmethod
    def relaxation(self, air: Air, state: OwnState, displaced: Values) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state, `None` where it is slow."""

    @abc.abstractmethod
    def signals(self, air: Air, state: OwnState, drive: Drive) -> dict[str, Array]:
        """What a simulation reports of it, by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self, air: Air) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""

    @property
    @abc.abstractmethod
    def longest_step(self) -> float:
        """Longest step in s that resolves it, infinite where the default does."""


class AbstractConverterPath(AbstractAirPath):
    """An air path whose plunger a magnet moves."""

    converter: eqx.AbstractVar[Converter]

    def working_pressure(self, air: Air, drive: Drive) -> Values:
        """That of the converter."""
        return self.converter.working_pressure(drive.pwm, ambient_pressure(air, drive), reservoir_pressure(0.0, drive))


class AirPathState(eqx.Module):
    """State of converter, line and chamber, one scalar a leaf (SI units)."""

    converter: ConverterState
    line: PyTree[StateLeaf]
    gas: GasState


class AirPath(AbstractConverterPath):
    """Converter, line and chamber [2.58, corrected]."""

    converter: Converter = eqx.field(default_factory=Converter)
    line: AbstractLine = eqx.field(default_factory=NoLine)
    chamber: AbstractChamber = eqx.field(default_factory=AdiabaticChamber)

    def start(self, air: Air, pressure: Values, drive: Drive) -> AirPathState:
        """The plunger balanced, the line filled, air of ambient temperature."""
        gas = GasState(pressure, jnp.broadcast_to(air.temperature, jnp.shape(pressure)))
        reservoir = reservoir_pressure(0.0, drive)
        converter = self.converter.start(drive.pwm, ambient_pressure(air, drive), reservoir, pressure)
        return AirPathState(converter, self.line.initial_state(air, gas), gas)

    def pressure(self, state: AirPathState) -> Values:
        """That of the gas in the chamber."""
        return state.gas.pressure

    def rates(
        self, air: Air, time: Values, state: AirPathState, drive: Drive, displaced: Values, displacement_rate: Values
    ) -> AirPathState:
        """Time derivative of the state [2.58]."""
        ambient, reservoir = ambient_pressure(air, drive), reservoir_pressure(time, drive)
        upstream, entering = self._port(air, state, ambient, reservoir, self.chamber.gas_volume(displaced))
        inflow, line_rate = self.line(air, state.line, entering, state.gas)
        return AirPathState(
            self.converter.rates(state.converter, drive.pwm, ambient, reservoir, upstream.pressure),
            line_rate,
            self.chamber.rates(air, state.gas, inflow, displaced, displacement_rate),
        )

    def relaxation(self, air: Air, state: AirPathState, displaced: Values) -> AirPathState:
        """Rates of plunger, magnet, line and gas."""
        return AirPathState(
            self.converter.relaxation(state.converter),
            self.line.relaxation(air, state.line, state.gas),
            self.chamber.relaxation(air, state.gas, displaced),
        )

    def signals(self, air: Air, state: AirPathState, drive: Drive) -> dict[str, Array]:
        """States and flows; `m_dot_in` comes from the atmosphere, `m_dot_out` goes to the reservoir.

        Where an orifice is wide enough for the converter's `widest_opening` to matter, it is what would flow without.
        """
        _, entering = self._port(air, state, ambient_pressure(air, drive), reservoir_pressure(0.0, drive))
        inflow, _ = self.line(air, state.line, entering, state.gas)
        flow, evacuating = entering.mass_flow, state.converter.plunger.position < 0
        return {
            **self.converter.signals(state.converter),
            **self.line.signals(state.line, inflow),
            "T_act": state.gas.temperature,
            "p_act": state.gas.pressure,
            "m_dot_in": jnp.where(evacuating, 0.0, flow),
            "m_dot_out": jnp.where(evacuating, -flow, 0.0),
        }

    def typical_state(self, air: Air) -> AirPathState:
        """That of the converter; ambient pressure and temperature."""
        gas = GasState(air.pressure, air.temperature)
        return AirPathState(self.converter.typical_state(), self.line.typical_state(gas), gas)

    @property
    def longest_step(self) -> float:
        """What the line resolves; everything else is resolved by the default."""
        return self.line.longest_step

    def _port(
        self, air: Air, state: AirPathState, ambient: Values, reservoir: Values, volume: Values | None = None
    ) -> tuple[GasState, Flow]:
        """What the converter sees, and the flow that leaves it, into a chamber of a volume in m3."""

        def flow(into: GasState) -> Flow:
            lift = state.converter.plunger.position
            return self.converter.flow(air, lift, ambient, reservoir, into.pressure, into.temperature, volume)

        return self.line.port(air, state.line, state.gas, flow)


class AbstractAirPathModel(AbstractModel):
    """A model with the full air path, whose parts are its own too."""

    air_path: eqx.AbstractVar[AirPath]

    converter = Inner[Converter]("air_path")
    line = Inner[AbstractLine]("air_path")
    chamber = Inner[AbstractChamber]("air_path")
