"""A controller as an FMU: its variables, and its C."""

from collections.abc import Sequence

from vgtjax.control import AbstractController
from vgtjax.traces import SIGNALS

from .law import FIRST, Law
from .primitives import literal
from .unit import Unit, define
from .variables import Variable, parameter_variables

UNITS = {"position": "m", "velocity": "m/s", "acceleration": "m/s2", "jerk": "m/s3"}
"""Of a reference and its derivatives."""
MEANINGS = {"pwm": "duty that the converter gets", "command": "duty that was asked for"}


def controller_unit(controller: AbstractController, period: float) -> Unit:
    """A sampled controller for co-simulation; `period` in s."""
    law = Law(controller, period)
    variables = list_variables(law)
    sizes = {
        "P": len(law.entries),
        "SETTINGS": 0,
        "S": 0,
        "U": len(law.inputs),
        "Y": len(law.outputs),
        "X": len(law.memory),
        "DX": 0,
    }
    more = [f"#define PERIOD {literal(period)}", "#define STARTS_LATE 1"]
    return Unit(
        identifier="vgtjax_controller",
        says=(
            f"Controller of the actuator's position, {type(controller).__name__}, sampled every {period!r} s from the "
            "start: the duty follows from the inputs at a sample, and is held to the next."
        ),
        variables=variables,
        code=_legend(law, variables)
        + define(law.to_c(), sizes, [False] * len(law.inputs), variables, more, ("controller.c",)),
        step=period,
        is_sampled=True,
    )


def _legend(law: Law, variables: Sequence[Variable]) -> str:
    """A comment in C on the order of the arrays, for whoever calls both functions without FMI."""
    known = {each.name: each for each in variables}
    sections = (
        ("p: gains and beliefs", [*law.entries]),
        ("u: inputs at a sample", [*law.inputs]),
        ("out: outputs of a sample, and behind them what is remembered next", [*law.outputs]),
        ("x: what is remembered", [f"memory.{name}" for name in law.memory]),
    )
    lines = []
    for title, names in sections:
        lines += ["", title, *(_place(i, known[name]) for i, name in enumerate(names))]
    return "\n".join(["/* Order of the arrays, SI units but for a duty in %.", *lines, "*/", ""])


def _place(number: int, variable: Variable) -> str:
    start = "" if variable.start is None else f" = {variable.start!r}"
    return f"  [{number}] {variable.name}{start}{'' if variable.unit in (None, '1') else f' {variable.unit}'}"


def list_variables(law: Law) -> list[Variable]:
    """All variables of a controller, in the order of their value references."""
    return [
        *parameter_variables(law.controller),
        *map(_input, law.inputs),
        *(_output(name) for name in law.outputs),
        *(Variable(f"memory.{name}", "local", "discrete", "what is remembered") for name in law.memory),
    ]


def _input(name: str) -> Variable:
    start = FIRST.get(name, 0.0)
    if name.startswith("reference."):
        wanted = name.removeprefix("reference.")
        meaning = "where the rod should be" if wanted == "position" else f"{wanted} of the reference"
        return Variable(name, "input", "continuous", meaning, UNITS[wanted], start)
    if name == "atmosphere":
        return Variable(name, "input", "continuous", "atmospheric pressure", "Pa absolute", start)
    meaning = SIGNALS[name].meaning.partition(",")[0]
    return Variable(name, "input", "continuous", f"measured {meaning}", SIGNALS[name].unit, start)


def _output(name: str) -> Variable:
    meaning = MEANINGS.get(name, "what the controller logs")
    return Variable(name, "output", "discrete", meaning, "%" if name in MEANINGS else None)
