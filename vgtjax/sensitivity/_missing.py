"""Which points serve which outputs when some rows are missing."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Int


def complete_groups(
    complete: Bool[np.ndarray, "points outputs"],
) -> Iterator[tuple[Int[np.ndarray, " used"], Int[np.ndarray, " columns"]]]:
    """Outputs that have the same complete points, with those points; every output once."""
    patterns, group = np.unique(complete, axis=1, return_inverse=True)
    for number, pattern in enumerate(patterns.T):
        yield np.flatnonzero(pattern), np.flatnonzero(group.ravel() == number)
