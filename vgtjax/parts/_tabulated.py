"""Parts that are read off a table in a simulation, because each value of theirs takes a computation of its own."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._types import Module
from ..parameters import AbstractDerived
from ..traces import Drive

Rows = Bool[Array, " rows"] | Bool[np.ndarray, " rows"]
"""Which rows of a table are needed."""


class AbstractTabulated(AbstractDerived):
    """A part with a table that is made of its parameters, and made anew whenever these have moved."""

    @abc.abstractmethod
    def table(self, rows: Rows | None = None) -> Array:
        """The table of the parameters as they are, differentiable with respect to them; if it has to be made, only the
        rows that are given, and infinite elsewhere."""

    @abc.abstractmethod
    def rows(self, *drives: Drive) -> Rows:
        """Which rows of the table are read along drives."""

    @abc.abstractmethod
    def with_table(self, table: Array) -> "AbstractTable":
        """What is read off a table in the part's place."""


class AbstractTable(eqx.Module):
    """What is read off a table."""

    @abc.abstractmethod
    def lost(self) -> Bool[Array, ""]:
        """Whether a computation of a point that the table was asked for has failed."""


def has_tables(model: eqx.Module) -> bool:
    """Whether a model has such parts."""
    return bool(_tabulated_parts(model))


def rows_of(model: eqx.Module, *drives: Drive) -> tuple[Rows, ...]:
    """Which rows of the tables of all such parts of a model are read along drives; none of most models."""
    return tuple(part.rows(*drives) for part in _tabulated_parts(model))


def tables_of(model: eqx.Module, rows: tuple[Rows, ...] | None = None) -> tuple[Array, ...]:
    """The tables of all such parts of a model, or at least some rows of them; none of most models."""
    parts = _tabulated_parts(model)
    return tuple(part.table(each) for part, each in zip(parts, rows or [None] * len(parts), strict=True))


def with_tables(model: Module, tables: tuple[Array, ...]) -> Module:
    """A model whose such parts are read off these tables."""
    left = iter(tables)
    return jax.tree.map(
        lambda part: part.with_table(next(left)) if _is_tabulated(part) else part, model, is_leaf=_is_tabulated
    )


def tabulated(model: Module) -> Module:
    """A model ready to be simulated: what would be computed at every step is read off tables."""
    return with_tables(model, tables_of(model))


def lost_points(model: eqx.Module | None) -> Bool[Array, ""] | None:
    """Whether tables that a model is read off have lost points; `None` of one without tables."""
    tables = [part.lost() for part in jax.tree.leaves(model, is_leaf=_is_table) if _is_table(part)]
    return jnp.any(jnp.stack(tables)) if tables else None


def _is_table(node: Any) -> bool:
    return isinstance(node, AbstractTable)


def _tabulated_parts(model: eqx.Module) -> list[AbstractTabulated]:
    return [part for part in jax.tree.leaves(model, is_leaf=_is_tabulated) if _is_tabulated(part)]


def _is_tabulated(node: Any) -> bool:
    return isinstance(node, AbstractTabulated)
