"""The radial design of variance-based sensitivity analysis: one sample for all the indices of this package."""

import dataclasses

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import InputError
from ..population import MOST_ROWS, Sample, check_size, sobol_points


@dataclasses.dataclass(frozen=True)
class RadialDesign(Sample):
    """Saltelli's design with radial steps (Saltelli et al., 2010; Campolongo, Saltelli and Cariboni, 2011).

    For every base point `n` the rows are `A_n`, then `AB_n^(1) .. AB_n^(d)`, then `B_n`, where `AB^(i)` is `A` with
    coordinate `i` taken from `B`: the order of SALib without second-order indices. `A` and `B` are the two halves of
    the coordinates of scrambled Sobol' points, so that the first base points are a smaller design of the same seed.

    **Arguments:** `dimensions`: the number of inputs `d`; `base`: the number of base points, best a power of two.

    **Raises:** `InputError` for more than 10600 dimensions or `2^30` base points.
    """

    dimensions: int
    base: int
    seed: int

    def __post_init__(self) -> None:
        check_size("the number of inputs of a radial design", self.dimensions, scipy.stats.qmc.Sobol.MAXDIM // 2)
        check_size("the number of base points", self.base, MOST_ROWS)

    @property
    def rows(self) -> int:
        """Number of points, `base (d + 2)`."""
        return self.base * self.members

    @property
    def members(self) -> int:
        """Number of rows that belong to one base point, `d + 2`."""
        return self.dimensions + 2

    def prefix(self, base: int) -> "RadialDesign":
        """The design of the first `base` base points, which are the first rows of this one.

        **Raises:** `InputError` when this design has fewer.
        """
        check_size("the base points of a part of the design", base, self.base)
        return dataclasses.replace(self, base=base)

    def base_points(
        self, begin: int, end: int
    ) -> tuple[Float[np.ndarray, "base dimensions"], Float[np.ndarray, "base dimensions"]]:
        """The rows `A` and `B` of base points `begin` to `end` (exclusive)."""
        both = sobol_points(2 * self.dimensions, self.seed, begin, end)
        return both[:, : self.dimensions], both[:, self.dimensions :]

    def _draw(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        first = begin // self.members
        a, b = self.base_points(first, -(-end // self.members))
        base, member = np.divmod(np.arange(begin, end), self.members)
        taken = np.arange(1, self.members - 1) == member[:, None]
        taken |= (member == self.members - 1)[:, None]
        return np.where(taken, b[base - first], a[base - first])

    def split(
        self, y: Float[np.ndarray, "rows outputs"]
    ) -> tuple[
        Float[np.ndarray, "base outputs"],
        Float[np.ndarray, "base dimensions outputs"],
        Float[np.ndarray, "base outputs"],
    ]:
        """The outputs at `A`, `AB` and `B`, from those of all rows; views, not copies.

        **Raises:** `InputError` when there is not one row of outputs per row of the design.
        """
        grouped = self.group(y)
        return grouped[:, 0], grouped[:, 1:-1], grouped[:, -1]

    def group(self, values: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "base members columns"]:
        """Rows gathered by base point, as a view.

        **Raises:** `InputError` when there is not one row per row of the design.
        """
        if values.ndim != 2 or len(values) != self.rows:
            raise InputError(
                f"values of this design must have the shape ({self.rows}, columns), but theirs is {values.shape}; "
                "give one row per row of the design, or take a part of the design by prefix()"
            )
        return values.reshape(self.base, self.members, values.shape[1])
