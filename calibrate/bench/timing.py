"""Timing of contestants in turn, so that whatever else the machine does slows all of them alike."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np


@dataclasses.dataclass(frozen=True)
class Timing:
    """Seconds of the first call, which may compile, and of every round after it."""

    first: float
    rounds: list[float]

    @property
    def median(self) -> float:
        """Median of the rounds in s."""
        return float(np.median(self.rounds))

    def ratio(self, other: "Timing") -> float:
        """How often `other` goes into this, as the median over the rounds that both took part in."""
        return float(np.median([mine / yours for mine, yours in zip(self.rounds, other.rounds, strict=False)]))


def once(function: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that one call takes until its result is there, and the result."""
    began = time.perf_counter()
    found = jax.block_until_ready(function())
    return time.perf_counter() - began, found


def interleave(contestants: Mapping[str, Callable[[], Any]], rounds: int) -> tuple[dict[str, Timing], dict[str, Any]]:
    """Times all contestants once to warm up, then in turn A B A B.

    **Returns:** a timing and the last result of each.
    """
    timings, results = {}, {}
    for name, function in contestants.items():
        first, results[name] = once(function)
        timings[name] = Timing(first, [])
    for _ in range(rounds):
        for name, function in contestants.items():
            seconds, results[name] = once(function)
            timings[name].rounds.append(seconds)
    return timings, results
