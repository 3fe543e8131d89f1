"""What arrays are called in annotations; the tests check them at run time, by jaxtyping.

An array is NumPy's or a number of Python outside of `jit`, and JAX's inside: annotations say shapes.
"""

from typing import TYPE_CHECKING, Any, TypeVar

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, PyTree, Shaped

Tree = TypeVar("Tree")
"""Any tree of arrays, which comes back with other leaves."""
Module = TypeVar("Module", bound=eqx.Module)
"""A model, a controller or a part of one, which comes back with other values."""

if TYPE_CHECKING:  # mypy knows no shapes, and would complain of sums and products of three kinds of numbers
    Scalar = Any
    Values = Any
    StateLeaf = Any
    Vector = Any
    Knots = Any
    OwnState = Any
else:
    Scalar = Float[ArrayLike, ""]
    """One number: an array without axes inside of `jit` and `vmap`, or a number of Python or NumPy outside."""
    Values = Float[ArrayLike, "..."]
    """One number or many: a law that is applied to each by itself; arguments of one call have shapes that broadcast."""
    StateLeaf = Float[ArrayLike, "..."] | None
    """One number of a state or of its time derivative; in a tree of relaxation rates (1/s) `None` where it is slow."""
    Vector = Float[ArrayLike, " parameters"]
    """One number per free entry of a model."""
    Knots = Float[ArrayLike, " _"]
    """Where a table has its values."""
    OwnState = PyTree[Shaped[ArrayLike, "..."]]
    """What a part, a plant or a controller remembers, in the class that others are derived from. Each of those narrows
    it to a class of its own, which mypy allows of an argument that is `Any` alone."""

Coordinates = Float[np.ndarray, " coordinates"]
"""What a search moves, on the host: one for each free entry, and behind them what else it may find out."""
