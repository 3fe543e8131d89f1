"""A plant as an FMU: its variables, and its C."""

import jax
import numpy as np

from vgtjax.parts import tabulated
from vgtjax.plants import AbstractModel
from vgtjax.simulation import FixedStep
from vgtjax.traces import ASSUMED_RESERVOIR, SIGNALS, STANDARD_ATMOSPHERE

from .equations import START, TRUTHS, Equations
from .primitives import literal
from .unit import Unit, define
from .variables import Variable, parameter_variables

COST = (
    "In model exchange the importer's solver must stop at every jump of the duty, and its steps must resolve the "
    "relaxation rates of plunger and friction (thousands per second); co-simulation has the integrator of vgtjax, "
    "which stays stable without."
)
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


def plant_unit(model: AbstractModel) -> Unit:
    """A model for model exchange and co-simulation; tables of its parts are made here, for good."""
    equations = Equations(tabulated(model))
    variables = list_variables(equations)
    settings = _settings(equations)
    sizes = {
        "P": len(equations.entries),
        "SETTINGS": len(settings),
        "S": len(START),
        "U": len(equations.inputs),
        "Y": len(equations.signals),
        "X": len(equations.states),
        "DX": len(equations.states),
    }
    held = [SIGNALS[name].held for name in equations.inputs]
    nominals = [each.nominal for each in variables if each.nominal is not None]
    more = [
        f"#define STANDARD_ATMOSPHERE {literal(STANDARD_ATMOSPHERE)}",
        "#define STARTS_LATE 0",
        f"static const double NOMINAL[] = {{{', '.join(map(literal, nominals))}}};",
    ]
    return Unit(
        identifier="vgtjax_actuator",
        says=f"Electro-pneumatic actuator of a turbocharger's vanes. {COST}",
        variables=variables,
        code=define(equations.to_c(), sizes, held, variables, more, ("plant.c", "exchange.c")),
        step=1e-3,
        is_sampled=False,
    )


def list_variables(equations: Equations) -> list[Variable]:
    """All variables of a model, in the order of their value references."""
    before = [
        *parameter_variables(equations.model),
        *_settings(equations),
        *_start(),
        *_inputs(equations),
        *_outputs(equations),
    ]
    return [*before, *_states(equations, len(before))]


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
