"""The variables of an FMU: each with its place in the array of all, which is its value reference."""

import dataclasses
from typing import Literal

import equinox as eqx

import vgtjax
from vgtjax.parameters import table_row

from .entries import entries_of, values_of

Causality = Literal["parameter", "input", "output", "local"]


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable as `modelDescription.xml` has it; `start` is `None` for what is computed."""

    name: str
    causality: Causality
    variability: Literal["fixed", "tunable", "discrete", "continuous"]
    description: str
    unit: str | None = None
    start: float | None = None
    nominal: float | None = None
    is_boolean: bool = False
    derivative_of: int | None = None
    """The place of the state whose derivative it is."""


def parameter_variables(model: eqx.Module) -> list[Variable]:
    """Every entry of the parameters of a model or a controller, in the order of `p`."""
    table, found = vgtjax.parameter_table(model), []
    for name, value in zip(entries_of(model), values_of(model).tolist(), strict=True):
        row = table_row(table, name)
        found.append(Variable(name, "parameter", "tunable", row.symbol, str(row.unit), value))
    return found
