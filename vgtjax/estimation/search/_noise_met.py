"""Whether a search ended where traces leave their noise and no more."""

import numpy as np

from ._search import LevenbergMarquardt

MEETS_NOISE = 1.05
"""chi^2 per measurement up to which a model meets the noise; at 1.08 the levels of one unit were called linear that the
plant had held."""
NOISE_ERROR = 3.0
"""Standard error of chi^2 per measurement, times the root of their number, as the noise is known from the traces
themselves: of `noise_level`'s square, by drawing white noise."""


def meets_noise(search: LevenbergMarquardt) -> bool:
    """Whether a search without corrections ended where the traces leave their noise, which few samples tell badly."""
    return 2 * search.progress.searched <= most_left(search)


def most_left(search: LevenbergMarquardt) -> float:
    """Chi^2 a sample that noise may leave."""
    return max(MEETS_NOISE, 1 + 2 * NOISE_ERROR / float(np.sqrt(search.problem.count)))
