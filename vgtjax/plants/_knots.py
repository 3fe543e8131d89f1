"""Models whose tables stand on other knots than the printed ones."""

from typing import Any

import numpy as np
from jaxtyping import Array

from .._types import Module
from ..parameters import as_float_array
from ..parts import AbstractGasTables
from ._base import assemble

KNOTS = ("turbine_pressure", "crank_angle")
Moves = dict[str, dict[str, Array]]
"""Knots by component, `vane_force` or `friction`, and by their name."""


def on_given_knots(model: Module, values: dict[str, Any]) -> Module:
    """`model` with its tables at the knots that `values` names, if it does, so that tables of that size fit in.

    **Arguments:** `model`: or a controller, which has no such tables and stays what it is; `values`: of parameters by
    name, of which only knots count: `vane_force.turbine_pressure`, `friction.crank_angle` and so on, lists or arrays.

    **Raises:** `InputError` for knots that don't increase.
    """
    return on_knots(model, other_knots(model, values))


def other_knots(model: Module, values: dict[str, Any]) -> Moves:
    """The knots of `values` at which the tables of a model do not stand; arguments as of [`on_given_knots`][]."""
    moves: Moves = {}
    for part in ("vane_force", "friction"):
        component = getattr(model, part, None)
        if isinstance(component, AbstractGasTables):
            stated = {knots: values.get(f"{part}.{knots}") for knots in KNOTS}
            given = {knots: as_float_array(v) for knots, v in stated.items() if v is not None and np.ndim(v)}
            # Reading at the knots that are there already would only round.
            if any(not np.array_equal(at, getattr(component, knots)) for knots, at in given.items()):
                moves[part] = given
    return moves


def on_knots(model: Module, moves: Moves) -> Module:
    """`model` with tables at such knots, also where they are traced."""
    return (
        assemble(model, **{part: getattr(model, part).on_knots(**knots) for part, knots in moves.items()})
        if moves
        else model
    )
