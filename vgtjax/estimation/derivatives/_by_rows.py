"""Rates differentiated by rows: each by the numbers that it depends on, once for all tangents.

Forward mode takes every tangent through all that a rate is made of. But some five dozen numbers say how the rates of a
state move with the states and the parameters of a model, and a tangent is a sum of their products.
"""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Literal, jaxpr_as_fun
from jaxtyping import Array, Bool

from ..._types import OwnState, Values
from ...plants import AbstractDynamics, AbstractModel, State
from ...traces import Drive

LARGEST = 64
"""Entries of an array by each of which a rate has a derivative of its own. A larger one is a table, of which a rate
reads a few: its tangents are taken through that."""

Flag = Bool[Array, ""]
Numbers = list[Array]
Rows = list[dict[int, Array]]
"""Derivatives of each rate by the numbers that it depends on, by their places."""


class ByRows(AbstractDynamics):
    """A model to take many tangents through: the same derivatives by a fifth of the operations.

    Its rates must have a reverse mode too, as all that a fit moves.
    """

    model: AbstractModel
    true: Flag
    """True, but no compiler knows that: see `_once`."""

    def vector_field(self, time: Values, state: OwnState, drive: Drive) -> State:
        """That of the model."""
        return _rates(_vector_field, self.true, (self.model, time, state, drive))

    def relaxation(self, time: Values, state: OwnState, drive: Drive) -> State:
        """That of the model."""
        return _rates(_relaxation, self.true, (self.model, time, state, drive))


def _vector_field(model: AbstractModel, *args: Any) -> Any:
    return model.vector_field(*args)


def _relaxation(model: AbstractModel, *args: Any) -> Any:
    return model.relaxation(*args)


@eqx.filter_custom_jvp
def _rates(function: Callable[..., Any], true: Flag, args: tuple[Any, ...]) -> Any:
    return function(*args)


@_rates.def_jvp
def _rates_jvp(primals: Any, tangents: Any) -> tuple[Any, Any]:
    (function, true, args), (_, _, along) = primals, tangents
    moving, still = eqx.partition(args, jax.tree.map(lambda each: each is not None, along, is_leaf=lambda x: x is None))
    shapes = eqx.filter_eval_shape(_rows, function, moving, still)
    like = jax.tree.map(lambda each: jnp.zeros(each.shape, each.dtype), shapes)
    rates, rows = _once(true, lambda: _rows(function, moving, still), like)
    (numbers, tables), (by_number, by_table) = _apart(moving), _apart(along)
    leaves, shape = jax.tree.flatten(like[0])
    moved = _once(true, _products, leaves, rows, by_number)
    if tables:
        whole = _Whole(function, moving, still)
        read = jax.jvp(lambda *tables: jax.tree.leaves(whole(numbers, list(tables))), tuple(tables), tuple(by_table))[1]
        moved = [a + b for a, b in zip(moved, read, strict=True)]
    return rates, jax.tree.unflatten(shape, moved)


@eqx.filter_jit
def _rows(function: Callable[..., Any], moving: Any, still: Any) -> tuple[Any, Rows]:
    """Rates and their rows; compiled for itself so that all stages of a step share what is traced."""
    numbers, tables = _apart(moving)
    traced, shapes = jax.make_jaxpr(_Whole(function, moving, still), return_shape=True)(numbers, tables)
    rates, push = jax.linearize(lambda *numbers: jaxpr_as_fun(traced)(*numbers, *tables), *numbers)
    rows = []
    for place, (rate, needed) in enumerate(zip(rates, _dependencies(traced), strict=True)):
        pull = jax.linear_transpose(lambda *along, place=place: push(*along)[place], *numbers)
        by_number = pull(jnp.ones_like(rate))
        rows.append({at: by_number[at] for at in needed if at < len(numbers)})
    return jax.tree.unflatten(jax.tree.structure(shapes), rates), rows


def _products(rows: Rows, along: Numbers) -> Numbers:
    return [sum((by * along[at] for at, by in row.items()), jnp.zeros_like(along[0])) for row in rows]


class _Whole:
    """Rates of the numbers and tables that arrays were taken apart into."""

    def __init__(self, function: Callable[..., Any], moving: Any, still: Any):
        self._function, self._still = function, still
        self._leaves, self._shape = jax.tree.flatten(moving)

    def __call__(self, numbers: Numbers, tables: Numbers) -> Any:
        next_number, next_table = iter(numbers), iter(tables)
        leaves = [
            jnp.stack([next(next_number) for _ in range(leaf.size)]).reshape(leaf.shape)
            if _is_small(leaf)
            else next(next_table)
            for leaf in self._leaves
        ]
        return self._function(*eqx.combine(jax.tree.unflatten(self._shape, leaves), self._still))


def _apart(tree: Any) -> tuple[Numbers, Numbers]:
    """The numbers in small arrays, and the others."""
    leaves = jax.tree.leaves(tree)
    numbers = [number for leaf in leaves if _is_small(leaf) for number in leaf.reshape(-1)]
    return numbers, [leaf for leaf in leaves if not _is_small(leaf)]


def _is_small(leaf: Array) -> bool:
    return leaf.size <= LARGEST


def _dependencies(traced: ClosedJaxpr) -> list[list[int]]:
    """The inputs that each output depends on."""
    reached = {variable: {at} for at, variable in enumerate(traced.jaxpr.invars)}

    def of(variables: Sequence[Any]) -> set[int]:
        return set().union(*(reached.get(each, set()) for each in variables if not isinstance(each, Literal)))

    for equation in traced.jaxpr.eqns:
        reached.update(dict.fromkeys(equation.outvars, of(equation.invars)))
    return [sorted(of([output])) for output in traced.jaxpr.outvars]


def _once(true: Flag, function: Callable[..., Any], like: Any, *operands: Any) -> Any:
    """What `function` gives, in arrays `like` these.

    In the loops that XLA makes of a step for a CPU each computes again, for every tangent, what others have as well;
    but what a choice gives is in memory.
    """
    if jax.default_backend() != "cpu":
        return function(*operands)
    return jax.lax.cond(true, function, lambda *_: like, *operands)
