"""A signal without the white noise of its sensor, corners and all."""

import numpy as np
import scipy

from ._channel import Samples

CREASE, FLAT, ROUGH = 0.6, 1.6e-5, 10.0
"""What a corner of the pressure costs, in units of its log-likelihood, below which size (in units of the noise) there
is none, and the weight of the convex first pass. On simulated bench traces 0.35 to 0.7, 1.6e-5 to 5e-5 and 10 to 100
leave 8 to 14 Pa of 60."""
PASSES = (15, 30)
"""Of the convex penalty, and of the logarithmic one."""


def remove_noise(samples: Samples, noise: float) -> Samples:
    """The signal through evenly sampled noisy ones that consists of as few parabolas as the noise allows.

    **Arguments:** `noise`: standard deviation of the white noise.
    """
    count = len(samples) - 3
    if count < 5 or noise <= 0:
        return samples
    scaled = samples / noise
    smooth = _penalised(scaled, np.full(count, 1e4 * ROUGH))
    for _ in range(PASSES[0]):
        size = np.abs(np.diff(smooth, 3))
        smooth = _penalised(scaled, ROUGH / np.hypot(size, 0.1 * np.median(size) + FLAT))
    for _ in range(PASSES[1]):
        smooth = _penalised(scaled, CREASE / (np.diff(smooth, 3) ** 2 + FLAT**2))
    return smooth * noise


THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
"""Coefficients of a third difference."""


def _penalised(samples: Samples, weights: np.ndarray) -> Samples:
    """Minimum of `|s - samples|^2 + sum(weights (third differences of s)^2)`."""
    bands = np.ones((4, len(samples)))
    bands[3] += np.convolve(weights, THIRD**2)
    for offset in range(1, 4):
        bands[3 - offset, offset:] = np.convolve(weights, THIRD[offset:] * THIRD[:-offset])
    return scipy.linalg.solveh_banded(bands, samples, overwrite_ab=True, check_finite=False)
