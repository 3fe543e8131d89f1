"""Confidence intervals of any index by resampling the independent points of its sample."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ._moments import Weights

FEWEST = 20
"""Replicates; fewer have no percentile near the ends of an interval."""
_CHUNK = 2**21
"""Weights made at a time: 16 MiB."""

Statistics = Callable[[Weights], dict[str, Float[np.ndarray, "replicates ..."]]]


@dataclasses.dataclass(frozen=True, eq=False)
class BootstrapInterval:
    """A statistic with the ends of its confidence interval, three arrays of one shape."""

    value: Float[np.ndarray, "..."]
    low: Float[np.ndarray, "..."]
    high: Float[np.ndarray, "..."]


def bootstrap(
    statistics: Statistics, points: int, *, replicates: int = 200, level: float = 0.95, seed: int = 0
) -> dict[str, BootstrapInterval]:
    """Percentile intervals of everything that `statistics` computes (Efron, 1979), those of independent points.

    **Arguments:**

    - `statistics`: takes weights `(replicates, points)` that sum to one in every row, returns arrays by name whose
      first axis is the replicate.
    - `points`: how many independent points the sample has; rows that were drawn together are one.
    - `level`: part of the replicates that the interval holds.

    **Raises:** `InputError` for fewer than 20 replicates, or a level that is not between 0 and 1.
    """
    if replicates < FEWEST:
        raise InputError(
            f"a bootstrap needs at least {FEWEST} replicates, but {replicates} were asked for; ask for more"
        )
    if not 0 < level < 1:
        raise InputError(f"the level of an interval must lie between 0 and 1, but it is {level:g}; 0.95 is usual")
    values = statistics(np.full((1, points), 1.0 / points))
    parts = [statistics(weights) for weights in resampled_weights(points, replicates, seed)]
    ends = [(1 - level) / 2, (1 + level) / 2]
    estimates = {}
    for name, value in values.items():
        low, high = np.quantile(np.concatenate([part[name] for part in parts]), ends, axis=0)
        estimates[name] = BootstrapInterval(value[0], low, high)
    return estimates


def resampled_weights(points: int, replicates: int, seed: int) -> Iterator[Float[np.ndarray, "replicates points"]]:
    """Weights of all replicates, some replicates at a time; what they are does not depend on how many."""
    generator = np.random.default_rng(seed)
    together = max(1, _CHUNK // points)
    for begin in range(0, replicates, together):
        weights = np.empty((min(together, replicates - begin), points))
        for row in weights:
            row[:] = np.bincount(generator.integers(points, size=points), minlength=points)
        yield weights / points
