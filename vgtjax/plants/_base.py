"""What the integrator, the fit and the studies need of a model of the actuator."""

import abc
import dataclasses
from typing import Any, Generic, TypeVar

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from .._types import Module, OwnState, StateLeaf, Values
from ..parts import Air
from ..traces import Drive, Start

State = PyTree[Float[Array, "..."]]


class AbstractDynamics(eqx.Module):
    """What a step needs of a model."""

    @abc.abstractmethod
    def vector_field(self, time: Values, state: OwnState, drive: Drive) -> State:
        """Time derivative of the state, `time` seconds after the start of the interval `drive`."""

    @abc.abstractmethod
    def relaxation(self, time: Values, state: OwnState, drive: Drive) -> PyTree[StateLeaf]:
        """Relaxation rate in 1/s of each state, shaped like the state, `None` where it is slow."""


class AbstractModel(AbstractDynamics):
    """A set of ordinary differential equations driven by a trace.

    Its parameters are its array leaves; its state is a PyTree of scalars that the model alone understands.
    """

    air: eqx.AbstractVar[Air]
    """The air around it, whose pressure is what gauge pressures count from."""

    @abc.abstractmethod
    def start(self, start: Start, drive: Drive) -> State:
        """State at the first sample; `drive` is the first interval."""

    @abc.abstractmethod
    def observe(self, state: OwnState, drive: Drive) -> tuple[Values, Values]:
        """What sensors see at the start of `drive`: position in m and chamber pressure in Pa absolute."""

    @abc.abstractmethod
    def signals(self, state: OwnState, drive: Drive) -> dict[str, Array]:
        """All that a simulation reports at the start of `drive`, by the names of the trace columns."""

    @abc.abstractmethod
    def typical_state(self) -> PyTree[StateLeaf]:
        """The usual size of each state, by which an absolute tolerance is scaled."""

    @property
    @abc.abstractmethod
    def longest_step(self) -> float:
        """Longest step in s that resolves the model's own dynamics, infinite where the default does."""

    @property
    @abc.abstractmethod
    def needs(self) -> tuple[str, ...]:
        """Columns that a trace must have to drive this model, alternatives joined by `|`."""

    @property
    def sensed(self) -> tuple[str, ...]:
        """Columns that tell what the model does, by which it is fitted; none of them drives it."""
        return ("x_d", "p_act")


T = TypeVar("T")


class Inner(Generic[T]):
    """A part of a module inside a model that is the model's own too: `diaphragm = Inner[Diaphragm]("rod")`."""

    def __init__(self, module: str):
        self._module = module

    def __set_name__(self, model: type, name: str) -> None:
        self.__doc__, self._name = f"That of `{self._module}`.", name

    def __get__(self, model: Any, kind: type | None = None) -> T:
        return self if model is None else getattr(getattr(model, self._module), self._name)  # type: ignore[return-value]


def assemble(whole: Module, **parts: Any) -> Module:
    """`whole` with those of its parts replaced that are given."""
    return dataclasses.replace(whole, **{name: part for name, part in parts.items() if part is not None})
