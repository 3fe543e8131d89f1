"""A model as its bench sees it: through sensors whose gain and offset may be off, from states that may be others."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .._types import OwnState, StateLeaf, Values
from ..parameters import Part, nested, parameter
from ..parts import Air, GasState, Rows, has_tables, rows_of, tables_of, with_tables
from ..traces import STANDARD_ATMOSPHERE, Drive, Ramp, Start
from ._base import AbstractModel, Inner, State

_SOURCE = "calibration of the bench"


def _gain(symbol: str) -> Any:
    return parameter(1.0, symbol=symbol, unit="1", source=_SOURCE, held=True)


def _offset(symbol: str, unit: str, usual: float, default: float | tuple[float, ...] = 0.0) -> Any:
    return parameter(default, symbol=symbol, unit=unit, source=_SOURCE, held=True, positive=False, usual=usual)


class Gains(Part):
    """What each sensor shows per what is there: of pressures per absolute one, of that before the turbine per gauge
    one, and of a chamber pressure that drives a rod per difference from atmosphere, at which its offset is read."""

    place = "gain"

    x_d: Array = _gain("g_x")
    p_act: Array = _gain("g_a")
    p_res: Array = _gain("g_r")
    p_trb: Array = _gain("g_t")
    f_drive: Array = _gain("g_f")


class Offsets(Part):
    """What the sensor of each input shows too much; those of what is fitted are eliminated with every fit."""

    place = "offset"

    p_act: Array = _offset("o_a", "Pa", 100.0)
    p_res: Array = _offset("o_r", "Pa", 100.0)
    p_trb: Array = _offset("o_t", "Pa", 100.0)
    f_drive: Array = _offset("o_f", "N", 0.1)


class Initial(Part):
    """By how much single traces begin elsewhere than at the mean of their first 50 ms, and with gas that is warmer than
    the air around, by `Trace.start_number - 1`."""

    place = "initial"

    x_d: Array = _offset("x_0", "m", 1e-5, ())
    p_act: Array = _offset("p_0", "Pa", 100.0, ())
    T_act: Array = _offset("T_0", "K", 10.0, ())

    def of(self, channel: str, start: Start) -> Values:
        """The difference of one trace, zero if it has none."""
        differences = getattr(self, channel)
        return jnp.concatenate([jnp.zeros(1, differences.dtype), differences])[start.number]


class Instrumented(AbstractModel):
    """A model that is driven by what its inputs' sensors show, less what these show too much, and seen through sensors
    with a gain.

    Gains, offsets and start states are parameters like any others, `gain.x_d` and so on, held unless they are freed by
    name. A trace has the same sensors as every other, and a start of its own.
    """

    model: AbstractModel = nested()
    gain: Gains = eqx.field(default_factory=Gains)
    offset: Offsets = eqx.field(default_factory=Offsets)
    initial: Initial = eqx.field(default_factory=Initial)
    air = Inner[Air]("model")

    def __init__(
        self,
        model: AbstractModel,
        gain: Gains | None = None,
        offset: Offsets | None = None,
        initial: Initial | None = None,
    ):
        self.model = model
        self.gain = Gains() if gain is None else gain
        self.offset = Offsets() if offset is None else offset
        self.initial = Initial() if initial is None else initial

    def start(self, start: Start, drive: Drive) -> State:
        """That of the model, at what was there."""
        seen = (lambda start: start.position, lambda start: start.pressure)
        position, pressure = start.position / self.gain.x_d, (start.pressure - self.offset.p_act) / self.gain.p_act
        there = [position + self.initial.of("x_d", start), pressure + self.initial.of("p_act", start)]
        begun = self.model.start(
            eqx.tree_at(lambda start: [get(start) for get in seen], start, there), self.true_drive(drive)
        )
        return _warmed(begun, self.initial.of("T_act", start))

    def vector_field(self, time: Values, state: OwnState, drive: Drive) -> State:
        """That of the model, driven by what was there."""
        return self.model.vector_field(time, state, self.true_drive(drive))

    def relaxation(self, time: Values, state: OwnState, drive: Drive) -> PyTree[StateLeaf]:
        """That of the model, driven by what was there."""
        return self.model.relaxation(time, state, self.true_drive(drive))

    def observe(self, state: OwnState, drive: Drive) -> tuple[Values, Values]:
        """What the sensors show of what the model does."""
        position, pressure = self.model.observe(state, self.true_drive(drive))
        return self.gain.x_d * position, self.gain.p_act * pressure

    def signals(self, state: OwnState, drive: Drive) -> dict[str, Array]:
        """Those of the model: what was there."""
        return self.model.signals(state, self.true_drive(drive))

    def typical_state(self) -> PyTree[StateLeaf]:
        """That of the model."""
        return self.model.typical_state()

    @property
    def longest_step(self) -> float:
        """That of the model."""
        return self.model.longest_step

    @property
    def needs(self) -> tuple[str, ...]:
        """Those of the model."""
        return self.model.needs

    @property
    def sensed(self) -> tuple[str, ...]:
        """Those of the model."""
        return self.model.sensed

    def true_drive(self, drive: Drive) -> Drive:
        """Inputs as they were, by what their sensors show."""
        channels = {"chamber": "p_act", "reservoir": "p_res", "turbine": "p_trb", "force": "f_drive"}
        given = {name: channel for name, channel in channels.items() if getattr(drive, name) is not None}
        ambient = {"p_act": STANDARD_ATMOSPHERE + drive.ambient_shift}
        there = [self._there(getattr(drive, name), each, ambient.get(each, 0.0)) for name, each in given.items()]
        return eqx.tree_at(lambda drive: [getattr(drive, name) for name in given], drive, there)

    def _there(self, shown: Ramp, channel: str, ambient: Values | float) -> Ramp:
        """An input by what its sensor shows, whose gain is that of the difference from `ambient`."""
        gain, offset = getattr(self.gain, channel), getattr(self.offset, channel)
        return Ramp(ambient + (shown.start - offset - ambient) / gain, shown.rate / gain)


def _warmed(state: State, kelvin: Values) -> State:
    """A state whose gas is warmer, where it has a temperature."""

    def is_gas(node: Any) -> bool:
        return isinstance(node, GasState)

    def warm(node: Any) -> Any:
        return GasState(node.pressure, node.temperature + kelvin) if is_gas(node) else node

    return jax.tree.map(warm, state, is_leaf=is_gas)


def rows_along(model: AbstractModel, *drives: Drive) -> tuple[Rows, ...]:
    """Which rows of the tables of a model's parts are read along what its inputs' sensors show; none of most models."""
    true = [model.true_drive(drive) for drive in drives] if isinstance(model, Instrumented) else drives
    return rows_of(model, *true)


def tabulated_along(model: AbstractModel, *drives: Drive) -> AbstractModel:
    """A model ready to be simulated along drives: what would be computed at every step is read off tables."""
    return with_tables(model, tables_of(model, rows_along(model, *drives))) if has_tables(model) else model


def bare(model: AbstractModel) -> AbstractModel:
    """A model without its sensors, if it has any."""
    return model.model if isinstance(model, Instrumented) else model
