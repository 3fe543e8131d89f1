"""What every set of sample points has in common: rows of the open unit cube, made on demand."""

import abc

import numpy as np
from jaxtyping import Float

from .._errors import InputError

MOST_ROWS = 2**30
"""A sample has no more base points than this: a 30-bit Sobol' sequence repeats itself after them."""


class Sample(abc.ABC):
    """Points of the open unit cube, addressed by their row, so that a batch can be made where it is simulated.

    A row has the same bits whatever slice it is asked for in, on any machine and in any order. No coordinate is ever 0
    or 1, so that the quantile of any distribution is finite there.
    """

    dimensions: int

    @property
    @abc.abstractmethod
    def rows(self) -> int:
        """Number of points."""

    @abc.abstractmethod
    def _draw(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        """The points of rows that are known to exist."""

    def points(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        """Rows `begin` to `end` (exclusive), in memory proportional to their number.

        **Raises:** `InputError` when there are no such rows.
        """
        if not 0 <= begin <= end <= self.rows:
            raise InputError(
                f"rows must lie between 0 and {self.rows}, but {begin} to {end} were asked for; "
                "ask for fewer, or for a larger sample"
            )
        return self._draw(begin, end)


def check_size(what: str, value: int, most: int) -> None:
    """Refuses sizes that are not between one and `most`."""
    if not 1 <= value <= most:
        raise InputError(f"{what} must be between 1 and {most}, but it is {value}; choose one in that range")
