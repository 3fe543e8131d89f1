"""Derivatives that fade while a loop runs, for loops whose derivatives grow without end."""

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array

from .._types import Scalar


def fade(tree: Any, kept: Scalar) -> Any:
    """The same tree; the derivatives of its floating leaves are multiplied by `kept`."""
    return jax.tree.map(lambda leaf: _fade(leaf, kept) if eqx.is_inexact_array(leaf) else leaf, tree)


@jax.custom_jvp
def _fade(leaf: Array, kept: Scalar) -> Array:
    return leaf


@_fade.defjvp
def _(primals, tangents):
    leaf, kept = primals
    return leaf, kept.astype(leaf.dtype) * tangents[0]
