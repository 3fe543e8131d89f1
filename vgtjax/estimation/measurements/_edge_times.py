"""What is known of the times of a duty's edges beforehand.

A record shows an edge at the first sample behind it: where it was is spread evenly over the sample before. How the
clock of the record lies beside that of the duty is not known, so what the edges of a trace have in common is left open,
as the delay of the duty where that is free, or else by a sample.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Scalar
from ._duties import Late

Seen = Float[Array | np.ndarray, "_ sample channel"]  # bundles have lanes of their own

MEAN, DEVIATION = -0.5, 12**-0.5
"""Samples by which an edge is late, of an even spread over the one before its record."""
COMMON = 1.0
"""Samples of standard deviation of what the edges of a trace have in common, unless the delay of the duty is free."""


class Edges(eqx.Module):
    """Edges of the duty whose times are not known: by how many samples of their record they are late where they are
    read, whether the delay of the duty is free beside them, and what is observed of every bundle when one is a sample
    later, `(lanes, sample, channel, edges)`.

    They were placed beside a delay of `placed` s. A trace whose edges are the only jumps of its duty stays there when
    that delay moves: by what is observed when all of them are a second later, as far as the linear problem goes, so
    that a trace tells of the delay just what is known of its edges beforehand.
    """

    late: Late = eqx.field(static=True)
    delay: bool = eqx.field(static=True)
    responses: list[Float[np.ndarray, "_ sample channel edges"]]
    together: list[Float[np.ndarray, "_ sample channel"]]
    placed: float = 0.0

    @property
    def most(self) -> int:
        """Edges of the trace that has the most."""
        return max(map(len, self.late))

    def moved(self, observed: Sequence[Seen], delay: Scalar) -> list[Array]:
        """What is observed of every bundle beside another delay of the duty in s, of traces that stayed where they
        were placed."""
        beyond = jnp.asarray(delay) - self.placed
        return [jnp.asarray(seen) + beyond * each for seen, each in zip(observed, self.together, strict=True)]

    def moving(self, columns: Sequence[Array | np.ndarray]) -> list[Array]:
        """Derivatives of what is observed, with that by the delay, the last one, of `moved`."""
        pairs = zip(columns, self.together, strict=True)
        return [jnp.asarray(each).at[..., -1].add(together) for each, together in pairs]

    def pulled(self, cotangent: Sequence[np.ndarray]) -> float:
        """The derivative with respect to the delay of a product of what is observed, in reverse mode."""
        return sum(float(np.sum(each * pull)) for each, pull in zip(self.together, cotangent, strict=True))


def covariance_root(count: int, *, delay: bool) -> Float[np.ndarray, "edges edges"]:
    """The lower root of the covariance of so many edges of a trace beforehand, in samples; the common part belongs to
    the `delay` of the duty if that is free."""
    common = DEVIATION if delay else COMMON
    return np.linalg.cholesky(DEVIATION**2 * np.eye(count) + common**2)


def from_mean(late: Late) -> Float[np.ndarray, "traces edges"]:
    """Samples by which edges are later than expected beforehand, a row for each trace with zeros behind its edges."""
    found = np.zeros((len(late), max(map(len, late))))
    for row, each in zip(found, late, strict=True):
        row[: len(each)] = np.subtract(each, MEAN)
    return found


def known_beforehand(
    late: Sequence[float], *, delay: bool
) -> tuple[Float[np.ndarray, " edges"], Float[np.ndarray, "edges edges"]]:
    """How far the edges of a trace are from what is known of them beforehand, in independent standard deviations, and
    how that changes with each."""
    rows = np.linalg.inv(covariance_root(len(late), delay=delay))
    return rows @ np.subtract(late, MEAN), rows
