"""Which part of some actuators keeps limits."""

import math
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float

CONFIDENCE = 0.95
Limits = tuple[float | None, float | None]
"""Lower and upper, either `None`."""


class Yield(NamedTuple):
    """A share of actuators, and the ends of its interval of 95 % as if these were independent (Clopper and Pearson,
    1934)."""

    share: float
    low: float
    high: float


def keeps(values: Float[np.ndarray, " rows"], limits: Limits) -> Bool[np.ndarray, " rows"]:
    """Which values lie within limits, without a guard band (simple acceptance); what is no number does not."""
    lower, upper = limits
    return (values >= (-math.inf if lower is None else lower)) & (values <= (math.inf if upper is None else upper))


def yield_of(kept: Bool[np.ndarray, " rows"]) -> Yield | None:
    """The share of rows that keep their limits; `None` of no row."""
    if not len(kept):
        return None
    interval = scipy.stats.binomtest(int(kept.sum()), len(kept)).proportion_ci(CONFIDENCE)
    return Yield(float(kept.mean()), float(interval.low), float(interval.high))
