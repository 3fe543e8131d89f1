"""Whether exhaust gas acts on a model."""

from typing import Any

import equinox as eqx
import jax

from .friction import AbstractFriction
from .vane_force import AbstractVaneForce


def feels_gas(model: eqx.Module) -> bool:
    """Whether turbine pressure changes any force of a model; if not, it does the same at every pressure."""

    def acts(node: Any) -> bool:
        return isinstance(node, AbstractVaneForce | AbstractFriction)

    return any(acts(part) and part.feels_gas for part in jax.tree.leaves(model, is_leaf=acts))
