"""Linear problems of a chain of cells, each of which feels two neighbours on either side.

Two cells together make a block tridiagonal matrix (3.70, erratum E19). Lineax solves those of scalars only; a dense
solution of 224 cells takes twenty times as long.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

REACH = 2
"""How many neighbours a cell feels on either side."""
COLOURS = 2 * REACH + 1

Band = Float[Array, "cells 5 variables variables"]
"""Derivatives of each cell's residuals with respect to the variables of five cells, from two before to two after."""
CellValues = Float[Array, "cells variables"]


def band_of(residual: Callable[[CellValues], CellValues], at: CellValues) -> tuple[CellValues, Band]:
    """A residual whose cells feel two neighbours, and its Jacobian: cells that no residual feels together move
    together."""
    cells, variables = at.shape
    moved = np.zeros((COLOURS, variables, cells, variables))
    for colour in range(COLOURS):
        for variable in range(variables):
            moved[colour, variable, colour::COLOURS, variable] = 1.0
    found, derivative = jax.linearize(residual, at)
    changes = jax.vmap(jax.vmap(derivative))(jnp.asarray(moved, at.dtype))
    here, offset = np.meshgrid(np.arange(cells), np.arange(-REACH, REACH + 1), indexing="ij")
    inside = (here + offset >= 0) & (here + offset < cells)
    band = jnp.moveaxis(changes, 1, -1)[(here + offset) % COLOURS, here]
    return found, jnp.where(inside[..., None, None], band, 0.0)


def solve_band(band: Band, right: CellValues) -> CellValues:
    """Solution of the linear problem of a band, by elimination from one end of the chain to the other (Thomas).

    Linear in `right`, so that derivatives with respect to that pass in both modes.
    """
    cells, variables = right.shape
    if cells % 2:
        idle = jnp.zeros_like(band[:1]).at[0, REACH].set(jnp.eye(variables, dtype=band.dtype))
        extended = solve_band(jnp.concatenate([band, idle]), jnp.concatenate([right, jnp.zeros_like(right[:1])]))
        return extended[:-1]
    before, diagonal, after = _paired(band)
    size = 2 * variables

    def eliminate(
        carry: tuple[Array, Array], block: tuple[Array, Array, Array, Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        (upper, known), (low, middle, high, given) = carry, block
        columns = jnp.concatenate([high, (given - low @ known)[:, None]], axis=1)
        solved = jnp.linalg.solve(middle - low @ upper, columns)
        return (solved[:, :-1], solved[:, -1]), (solved[:, :-1], solved[:, -1])

    def substitute(following: Array, block: tuple[Array, Array]) -> tuple[Array, Array]:
        upper, known = block
        here = known - upper @ following
        return here, here

    nothing = jnp.zeros((size, size), right.dtype), jnp.zeros(size, right.dtype)
    _, eliminated = jax.lax.scan(eliminate, nothing, (before, diagonal, after, right.reshape(-1, size)))
    _, solution = jax.lax.scan(substitute, nothing[1], eliminated, reverse=True)
    return solution.reshape(cells, variables)


def _paired(band: Band) -> tuple[Array, Array, Array]:
    """Blocks below, on and above the diagonal, of two cells each."""
    cells, _, variables, _ = band.shape
    pairs = band.reshape(cells // 2, 2, COLOURS, variables, variables)
    nothing = jnp.zeros_like(pairs[:, 0, 0])

    def block(first: int) -> Array:
        """Columns of two cells, the first of which is so many after the pair's first."""
        rows = []
        for member in range(2):
            offsets = [first + column - member + REACH for column in range(2)]
            columns = [pairs[:, member, offset] if 0 <= offset < COLOURS else nothing for offset in offsets]
            rows.append(jnp.concatenate(columns, axis=-1))
        return jnp.concatenate(rows, axis=-2)

    return block(-2), block(0), block(2)
