"""Samples that are no measurements: those of a sensor at an end of its range, and values that a logger repeats."""

import numpy as np
from jaxtyping import Bool

from ._channel import Samples
from ._robust import deviation_by_differences

FEWEST, TOGETHER = 10, 3
"""Samples that show the least or the greatest value of all, and how many of them in a row, from which a sensor stands
at an end of its range. Of one with noise that covers `NOISY` steps of its record one sample does, or two."""
NOISY = 3.0
"""Steps of a record that the noise must cover: less of it, and a sensor shows a value again and again by itself."""
NEAR = 4.0
"""Deviations of the noise from the end within which other samples say nothing either: of those the noise has let only
one half come through."""
TURNING = 0.6
"""Share of third differences that have another sign than the one before, from which they are noise: 0.77 of white
noise, 0.73 behind a low pass, and far less than half of a smooth signal that was simulated without any."""
LIKE = 0.9
"""Share of all runs of one value that must be as long as the usual one, or a sample more or less."""


def at_ends_of_range(values: Samples) -> Bool[np.ndarray, " samples"]:
    """Which samples a sensor shows at an end of its range, or so near that its noise was cut there.

    A constant signal, one without noise and one whose record is coarser than its noise have none: nothing tells an end
    of theirs from a value at rest.
    """
    outside = np.zeros(len(values), dtype=bool)
    for end in (np.min(values), np.max(values)):
        here = values == end
        if np.sum(here) < FEWEST or _longest_run(here) < TOGETHER:
            continue
        noise = _noise_of(values[~here])
        if noise > NOISY * _step_of(values):
            outside |= np.abs(values - end) <= NEAR * noise
    return outside


def repeated(values: Samples) -> Bool[np.ndarray, " samples"]:
    """Which samples only repeat the one before, where a logger writes a slow sensor at the rate of a faster one: each
    of its values stands for two samples or more, always as many.

    A signal without noise, and one whose record is coarser than its noise, repeats values by itself.
    """
    again = np.append(False, np.diff(values) == 0)
    lengths = np.diff(np.flatnonzero(np.append(~again, True)))
    usual = np.median(lengths)
    alike = np.mean(np.abs(lengths - usual) <= 1)
    if usual < 2 or alike < LIKE or _noise_of(values[~again]) <= NOISY * _step_of(values):
        return np.zeros(len(values), dtype=bool)
    return again


def _longest_run(here: Bool[np.ndarray, " samples"]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], here.astype(int), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _noise_of(values: Samples) -> float:
    """The noise as `noise_level` has it, without its floor; zero of a smooth signal."""
    third = np.diff(values, n=3)
    if len(third) < FEWEST or np.mean(third[1:] * third[:-1] < 0) < TURNING:
        return 0.0
    return deviation_by_differences(values)


def _step_of(values: Samples) -> float:
    """The smallest step of a record."""
    steps = np.diff(np.unique(values))
    return float(np.min(steps)) if len(steps) else 0.0
