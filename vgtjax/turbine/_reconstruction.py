"""States at the faces of cells, second order where the flow is smooth."""

import jax.numpy as jnp
import numpy as np

from .._types import Values
from ._passage import Passage
from ._riemann import States

SMOOTH_SLOPE = 0.02
"""Change over the length of the passage, in units of the usual sizes, below which slopes are not limited: it keeps the
limiter differentiable where nothing changes."""


def at_faces(passage: Passage, states: States, scale: Values) -> tuple[States, States]:
    """States before and after each face (van Leer's MUSCL); at the ends only the side within the passage means
    anything."""
    centres = passage.centres
    slopes = _slopes(passage, states / scale[None], centres) * scale[None]
    before = states + slopes * (passage.m[1:] - centres)[:, None]
    after = states + slopes * (passage.m[:-1] - centres)[:, None]
    return jnp.concatenate([after[:1], before]), jnp.concatenate([after, before[-1:]])


def _slopes(passage: Passage, states: States, centres: Values) -> States:
    """Van Albada's mean of the slopes on both sides; of one side where the other is another row, whose blades begin or
    end to turn the gas there."""
    between = jnp.diff(states, axis=0) / jnp.diff(centres)[:, None]
    left, right = jnp.concatenate([between[:1], between]), jnp.concatenate([between, between[-1:]])
    row = jnp.asarray(passage.row)
    ends = np.ones(1, bool)
    edge = row[1:] != row[:-1]
    edge_left, edge_right = jnp.concatenate([ends, edge])[:, None], jnp.concatenate([edge, ends])[:, None]
    left, right = jnp.where(edge_left, right, left), jnp.where(edge_right, left, right)
    small = (SMOOTH_SLOPE / (passage.m[-1] - passage.m[0])) ** 2
    mean = (left * (right**2 + small) + right * (left**2 + small)) / (left**2 + right**2 + 2 * small)
    return jnp.where(edge_left & edge_right, 0.0, mean)
