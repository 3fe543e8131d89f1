"""The benchmarks, one file each; every one returns a table."""

from collections.abc import Callable

from ..table import Section
from . import batch, cold_start, coverage, fit, forward, jacobian, opponents, population, robustness, tuning

CASES: dict[str, Callable[[], Section]] = {
    "forward": forward.measure,
    "jacobian": jacobian.measure,
    "batch": batch.measure,
    "fit": fit.measure,
    "cold-start": cold_start.measure,
    "population": population.measure_population,
    "tuning": tuning.measure,
    "opponents": opponents.measure,
    "robustness": robustness.measure,
    "coverage": coverage.measure,
    "memory": population.measure_memory,
}
"""By the name on the command line, in the order in which they run."""
