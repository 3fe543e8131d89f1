"""A signal without the white noise of its sensor, corners and all."""

import numpy as np
import scipy
from jaxtyping import Bool

from ._channel import Samples

CREASE, FLAT, ROUGH = 0.6, 1.6e-5, 10.0
"""What a corner of the pressure costs, in units of its log-likelihood, below which size (in units of the noise) there
is none, and the weight of the convex first pass. On simulated bench traces 0.35 to 0.7, 1.6e-5 to 5e-5 and 10 to 100
leave 8 to 14 Pa of 60."""
PASSES = (15, 30)
"""Of the convex penalty, and of the logarithmic one."""


def remove_noise(samples: Samples, noise: float, seen: Bool[np.ndarray, " samples"] | None = None) -> Samples:
    """The signal through evenly sampled noisy ones that consists of as few parabolas as the noise allows.

    **Arguments:** `noise`: standard deviation of the white noise; `seen`: which samples there are, by default all.
    """
    count = len(samples) - 3
    if count < 5 or noise <= 0:
        return samples
    scaled, seen = samples / noise, np.ones(len(samples), bool) if seen is None else seen
    smooth = _penalised(scaled, np.full(count, 1e4 * ROUGH), seen)
    for _ in range(PASSES[0]):
        size = np.abs(np.diff(smooth, 3))
        smooth = _penalised(scaled, ROUGH / np.hypot(size, 0.1 * np.median(size) + FLAT), seen)
    for _ in range(PASSES[1]):
        smooth = _penalised(scaled, CREASE / (np.diff(smooth, 3) ** 2 + FLAT**2), seen)
    return smooth * noise


THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
"""Coefficients of a third difference."""


MOVES = 200.0
"""Pa by which the halves of a chamber's rest differ at least where it is filled or vented; slow noise makes tens."""


def drift_of(rest: Samples) -> float:
    """By how much the mean of the second half of a rest is above that of the first."""
    half = len(rest) // 2
    return float(np.mean(rest[half:]) - np.mean(rest[:half])) if half else 0.0


def _penalised(samples: Samples, weights: np.ndarray, seen: Bool[np.ndarray, " samples"]) -> Samples:
    """Minimum of `|s - samples|^2 + sum(weights (third differences of s)^2)`, over the samples that were seen."""
    bands = np.ones((4, len(samples)))
    bands[3] = seen + np.convolve(weights, THIRD**2)
    for offset in range(1, 4):
        bands[3 - offset, offset:] = np.convolve(weights, THIRD[offset:] * THIRD[:-offset])
    return scipy.linalg.solveh_banded(bands, np.where(seen, samples, 0.0), overwrite_ab=True, check_finite=False)
