"""The parameters of a model or a controller as one vector, in the order of its parameter table."""

import re
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

import vgtjax
from vgtjax.parameters import entry_names

Vector = Float[Array, " entries"]


def entries_of(model: eqx.Module) -> list[str]:
    """Names of all entries."""
    return entry_names(vgtjax.parameter_table(model))


def values_of(model: eqx.Module) -> Float[np.ndarray, " entries"]:
    """The model's own values."""
    return vgtjax.Selection(tuple(entries_of(model))).values(model)


def with_values(model: eqx.Module, values: Vector) -> Any:
    """The model with others."""
    place, found = 0, {}
    for name, row in vgtjax.parameter_table(model).items():
        size = row.size or 1
        found[name] = values[place] if row.size is None else values[place : place + size]
        place += size
    return vgtjax.replace_parameters(model, found)


def path_of(path: Any) -> str:
    """The place of a leaf of a tree as a name: `a.b[0]`."""
    return re.sub(r"\.(\d+)", r"[\1]", jax.tree_util.keystr(path, simple=True, separator="."))
