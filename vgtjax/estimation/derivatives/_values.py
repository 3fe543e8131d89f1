"""What a simulation is made of and a fit moves: parameters, the tables of parts that are made of them, and how both
move with each parameter."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._kept import keep_compiled
from ...parameters import Selection
from ...parts import Rows, has_tables, tables_of, with_tables
from ...plants import AbstractModel, rows_along
from ._bundle import Bundle

Choose = Callable[[Any], AbstractModel]
"""Makes a model of values."""
Pushed = tuple[Any, Any]
"""Values, and tangents of them with a leading axis of parameters."""
Gradient = Float[Array, " parameters"]


def chooser(model: AbstractModel, selection: Selection) -> Choose:
    """What makes a model of the selected parameters and its tables."""

    def choose(values: Any) -> AbstractModel:
        theta, tables = values
        return with_tables(selection.unpack(model, theta), tables)

    return choose


def push_values(model: AbstractModel, selection: Selection, rows: tuple[Rows, ...]) -> Pushed:
    """The parameters and rows of the model's tables, and a tangent of both for each parameter."""
    theta = selection.pack(model)
    return push_all(
        lambda theta: (theta, tables_of(selection.unpack(model, theta), rows)),
        theta,
        jnp.eye(len(theta), dtype=theta.dtype),
    )


def values_before(model: AbstractModel, selection: Selection, bundle: Bundle) -> Pushed | None:
    """What `push_values` gives of a model with tables.

    They are made before, in a program without lanes: where lanes are spread, devices would wait for each other at every
    step on the way to a table.
    """
    return _values_of(model, selection, rows_along(model, bundle.drive)) if has_tables(model) else None


@keep_compiled
def _values_of(model: AbstractModel, selection: Selection, rows: tuple[Rows, ...]) -> Pushed:
    return push_values(model, selection, rows)


def push_all(function: Callable[[Any], Any], at: Any, tangents: Any) -> Pushed:
    """A function's value, and where it moves along every tangent."""
    return jax.vmap(lambda along: jax.jvp(function, (at,), (along,)), out_axes=(None, 0))(tangents)


def pull_values(tangents: Any, by_values: Any) -> Gradient:
    """Derivatives with respect to the parameters, of those with respect to the values that move with them.

    Forward mode says how a table moves, also in reverse mode: a few parameters move thousands of numbers that searches
    inside of searches find, whose own reverse takes longer to compile than a fit takes.
    """
    shares = jax.tree.map(lambda along, by: jnp.tensordot(along, by, by.ndim), tangents, by_values)
    return jnp.sum(jnp.stack(jax.tree.leaves(shares)), axis=0)
