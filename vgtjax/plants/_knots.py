"""Models whose tables stand on other knots than the printed ones."""

from typing import Any

import numpy as np

from .._types import Module
from ..parameters import as_float_array
from ..parts import AbstractGasTables
from ._base import assemble

KNOTS = ("turbine_pressure", "crank_angle")


def on_given_knots(model: Module, values: dict[str, Any]) -> Module:
    """`model` with its tables at the knots that `values` names, if it does, so that tables of that size fit in.

    **Arguments:** `model`: or a controller, which has no such tables and stays what it is; `values`: of parameters by
    name, of which only knots count: `vane_force.turbine_pressure`, `friction.crank_angle` and so on, lists or arrays.

    **Raises:** `InputError` for knots that don't increase.
    """
    for part in ("vane_force", "friction"):
        component = getattr(model, part, None)
        if isinstance(component, AbstractGasTables):
            stated = {knots: values.get(f"{part}.{knots}") for knots in KNOTS}
            given = {knots: as_float_array(v) for knots, v in stated.items() if v is not None and np.ndim(v)}
            # Reading at the knots that are there already would only round.
            if any(not np.array_equal(at, getattr(component, knots)) for knots, at in given.items()):
                model = assemble(model, **{part: component.on_knots(**given)})
    return model
