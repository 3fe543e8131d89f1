"""Models whose tables stand on other knots than the printed ones."""

import operator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..parts import AdaptiveLuGre, HysteresisMap
from ._base import AbstractModel


def on_given_knots(model: AbstractModel, values: dict[str, Any]) -> Any:
    """`model` with its tables at the knots that `values` names, if it does, so that tables of that size fit in.

    **Arguments:** `values`: of parameters by name, of which only knots count: `vane_force.turbine_pressure`,
    `friction.crank_angle` and so on, lists or arrays.

    **Raises:** `InputError` for knots that don't increase.
    """
    for part in ("vane_force", "friction"):
        component = getattr(model, part, None)
        if not isinstance(component, HysteresisMap | AdaptiveLuGre):
            continue
        given = [values.get(f"{part}.{knots}") for knots in ("turbine_pressure", "crank_angle")]
        if any(np.ndim(knots) for knots in given if knots is not None):
            old = (component.turbine_pressure, component.crank_angle)
            new = [o if g is None else jnp.asarray(g, float) for o, g in zip(old, given, strict=True)]
            model = eqx.tree_at(operator.attrgetter(part), model, component.on_knots(*new))
    return model
