"""Parts that are read off a table in a simulation, because each value of theirs takes a computation of its own."""

import abc
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array

from ..parameters import AbstractDerived


class AbstractTabulated(AbstractDerived):
    """A part with a table that is made of its parameters, and made anew whenever these have moved."""

    @abc.abstractmethod
    def table(self) -> Array:
        """The table of the parameters as they are, differentiable with respect to them."""

    @abc.abstractmethod
    def with_table(self, table: Array) -> eqx.Module:
        """What is read off a table in the part's place."""


def has_tables(model: Any) -> bool:
    """Whether a model has such parts."""
    return any(_is_tabulated(part) for part in jax.tree.leaves(model, is_leaf=_is_tabulated))


def tables_of(model: Any) -> tuple[Array, ...]:
    """The tables of all such parts of a model; none of most models."""
    return tuple(part.table() for part in jax.tree.leaves(model, is_leaf=_is_tabulated) if _is_tabulated(part))


def with_tables(model: Any, tables: tuple[Array, ...]) -> Any:
    """A model whose such parts are read off these tables."""
    left = iter(tables)
    return jax.tree.map(
        lambda part: part.with_table(next(left)) if _is_tabulated(part) else part, model, is_leaf=_is_tabulated
    )


def tabulated(model: Any) -> Any:
    """A model ready to be simulated: what would be computed at every step is read off tables."""
    return with_tables(model, tables_of(model))


def _is_tabulated(node: Any) -> bool:
    return isinstance(node, AbstractTabulated)
