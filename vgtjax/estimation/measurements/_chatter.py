"""What a sharp simulation chatters, in the phase of the record.

Where a slow duty is held between samples, a plunger at the jump of its orifice opens after one sample and shuts after
the next. The plant does that as well; whether at the even samples or the odd ones is chance, and the wrong one of the
two would leave twice the swing: 200 of chi^2 for 400 samples of 20 Pa beside a noise of 60 Pa. With a linear duty it
opens and shuts without a phase that holds, and only the middle is worth anything.
"""

import numpy as np
import scipy
from jaxtyping import Bool

from ._sensors import Samples

MIDDLE = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
"""Weights of neighbours, among which what alternates from sample to sample cancels."""
AROUND, LEAST_TURNS = 9, 0.5
"""Samples around one, and the share of them at which the difference turns back where it chatters."""
STRETCH = 50
"""Samples over which a phase may hold: few enough to follow where it slips, many enough to show it."""


def in_phase(defect: Samples, left: Samples, deviation: float) -> Samples:
    """The difference of a sharp simulation from a smooth one, whose swing from sample to sample has the sign and the
    size that the record shows, and at most its own size; where the record shows none it is taken away.

    **Arguments:** `left`: what the smooth simulation leaves of the record; `deviation` of the sensor's noise; all in
    one unit.
    """
    swing, shown = np.where(_chatters(defect), _quick(defect), 0.0), _quick(left)
    corrected = defect - swing
    for begin in range(0, len(defect), STRETCH):
        mine = slice(begin, begin + STRETCH)
        square = float(swing[mine] @ swing[mine])
        if square > 0.0:
            # Beforehand any factor up to about one is as likely with either sign.
            factor = _proportion(swing[mine], shown[mine]) * square / (square + deviation**2)
            corrected[mine] += np.clip(factor, -1.0, 1.0) * swing[mine]
    return corrected


def _proportion(swing: Samples, shown: Samples) -> float:
    """The factor of a swing that leaves the least sum of absolute differences from what is shown: one outlier does not
    tell it."""
    moves = swing != 0.0
    ratios, weights = shown[moves] / swing[moves], np.abs(swing[moves])
    order = np.argsort(ratios)
    half = np.searchsorted(np.cumsum(weights[order]), 0.5 * np.sum(weights))
    return float(ratios[order][half])


def _quick(samples: Samples) -> Samples:
    """What alternates from sample to sample."""
    return samples - scipy.ndimage.convolve1d(samples, MIDDLE, mode="nearest")


def _chatters(defect: Samples) -> Bool[np.ndarray, " samples"]:
    """Whether a difference turns to and fro around a sample."""
    moves, turns = np.diff(defect), np.zeros(len(defect))
    turns[1:-1] = moves[1:] * moves[:-1] < 0
    return scipy.ndimage.uniform_filter1d(turns, AROUND, mode="nearest") >= LEAST_TURNS
