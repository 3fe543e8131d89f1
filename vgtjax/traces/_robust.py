"""Standard deviations by medians, which outliers don't move."""

import math

import numpy as np
from jaxtyping import Float

NORMAL_MEDIAN = 0.6744897501960817
"""Median size of a standard normal deviate."""


def robust_deviation(deviates: Float[np.ndarray, " samples"]) -> float:
    """Standard deviation of normal deviates about zero by their median size, in their unit."""
    return float(np.median(np.abs(deviates))) / NORMAL_MEDIAN


def deviation_by_differences(samples: Float[np.ndarray, " samples"], order: int = 3) -> float:
    """Standard deviation of the white noise on a slowly moving signal, in its unit: the robust scale of differences of
    that order, whose variance is the noise's `comb(2 order, order)` times."""
    return robust_deviation(np.diff(samples, n=order)) / math.sqrt(math.comb(2 * order, order))
