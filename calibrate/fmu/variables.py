"""The variables of an FMU: each with its place in the array of all, which is its value reference."""

import dataclasses
from typing import Literal

import jax
import numpy as np

import vgtjax
from vgtjax.parameters import table_row
from vgtjax.simulation import FixedStep
from vgtjax.traces import ASSUMED_RESERVOIR, SIGNALS, STANDARD_ATMOSPHERE

from .equations import START, TRUTHS, Equations

Causality = Literal["parameter", "input", "output", "local"]
START_MEANINGS = {
    "at_rest": "whether the first duty is zero and the chamber at atmosphere",
    "pressure": "chamber pressure at the start",
    "pressure_known": "whether start.pressure is known; else it follows from position or duty",
    "position": "position at the start",
    "position_known": "whether start.position is known; else it is in static balance",
}
START_UNITS = {"pressure": "Pa absolute", "position": "m"}
REST = {"at_rest": 1.0}
FIRST = {"p_res": ASSUMED_RESERVOIR, "p_act": STANDARD_ATMOSPHERE}
"""Inputs that don't begin at zero."""


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


def list_variables(equations: Equations) -> list[Variable]:
    """All variables of a model, in the order of their value references."""
    before = [*_parameters(equations), *_settings(equations), *_start(), *_inputs(equations), *_outputs(equations)]
    return [*before, *_states(equations, len(before))]


def _parameters(equations: Equations) -> list[Variable]:
    table, found = vgtjax.parameter_table(equations.model), []
    for name, value in zip(equations.entries, equations.values.tolist(), strict=True):
        row = table_row(table, name)
        found.append(Variable(name, "parameter", "tunable", row.symbol, str(row.unit), value))
    return found


def _settings(equations: Equations) -> list[Variable]:
    longest = min(FixedStep().max_step, equations.model.longest_step)
    steps = "longest step of the integrator in co-simulation, which divides the communication step evenly"
    air = "pressure that the gauges of a trace count from; what it differs from the standard shifts air.pressure"
    return [
        Variable("max_step", "parameter", "tunable", steps, "s", longest),
        Variable("atmosphere", "parameter", "tunable", air, "Pa absolute", STANDARD_ATMOSPHERE),
    ]


def _start() -> list[Variable]:
    return [
        Variable(
            f"start.{name}",
            "parameter",
            "fixed",
            START_MEANINGS[name],
            START_UNITS.get(name),
            REST.get(name, 0.0),
            is_boolean=name in TRUTHS,
        )
        for name in START
    ]


def _inputs(equations: Equations) -> list[Variable]:
    return [
        Variable(
            name,
            "input",
            "discrete" if SIGNALS[name].held else "continuous",
            SIGNALS[name].meaning,
            SIGNALS[name].unit,
            FIRST.get(name, 0.0),
        )
        for name in equations.inputs
    ]


def _outputs(equations: Equations) -> list[Variable]:
    return [
        Variable(name, "output", "continuous", SIGNALS[name].meaning, SIGNALS[name].unit) for name in equations.signals
    ]


def _states(equations: Equations, place: int) -> list[Variable]:
    sizes = np.asarray(jax.tree.leaves(equations.model.typical_state()), float).tolist()
    states = [
        Variable(f"state.{name}", "local", "continuous", "state", nominal=size)
        for name, size in zip(equations.states, sizes, strict=True)
    ]
    rates = [
        Variable(f"der({each.name})", "local", "continuous", "its derivative", derivative_of=place + i)
        for i, each in enumerate(states)
    ]
    return [*states, *rates]
