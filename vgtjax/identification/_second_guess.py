"""What traces tell of a few parameters without a simulation, where the others are given: a start for a fit."""

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._errors import InputError
from ..plants import AbstractModel, AbstractRodModel, as_actuator
from ..traces import Trace
from ._pipeline import apply, plan
from .mechanical import identify_spring
from .pneumatic import identify_magnetic_force

DIRECT = (identify_spring, identify_magnetic_force)
"""Tests that solve linear equations of what was measured."""


def second_guess(model: AbstractModel, traces: Sequence[Trace]) -> dict[str, Any]:
    """Springs, travel and magnetic force by name, as far as slow motion and equilibria tell them [2.8, 2.36].

    From a travel that is too long, or a magnetic force that never moves the plunger, a search has no way on: what it
    simulates does not depend on them.
    """
    found: dict[str, Any] = {}
    if not isinstance(model, AbstractRodModel):
        return found
    model = as_actuator(model) or model
    for test, mine in plan(model, traces):
        if test in DIRECT:
            # It is only a guess: where its equations have no solution, or one that no actuator has, there is none.
            with contextlib.suppress(InputError, np.linalg.LinAlgError):
                values = test(model, mine)
                model = apply(model, values)
                found |= {name: value for name, value in values.values.items() if np.all(np.isfinite(value))}
    return found
