"""The benchmarks, one file each; every one returns a table."""

from collections.abc import Callable

from ..table import Section
from . import (
    accelerator,
    adaptive_gains,
    batch,
    choked_flow,
    cold_start,
    coverage,
    files,
    fit,
    fleet_coverage,
    flow,
    forward,
    jacobian,
    nozzle,
    opponents,
    population,
    pulsating_flow,
    random_nozzles,
    robustness,
    scaling,
    tuning,
    unknown_plants,
    wider_plants,
)

CASES: dict[str, Callable[..., Section]] = {
    "forward": forward.measure,
    "jacobian": jacobian.measure,
    "batch": batch.measure,
    "fit": fit.measure,
    "flow": flow.measure,
    "nozzle": nozzle.measure,
    "pulsating-flow": pulsating_flow.measure,
    "choked-flow": choked_flow.measure,
    "random-nozzles": random_nozzles.measure,
    "scaling": scaling.measure,
    "cold-start": cold_start.measure,
    "population": population.measure_population,
    "tuning": tuning.measure,
    "opponents": opponents.measure,
    "robustness": robustness.measure,
    "coverage": coverage.measure,
    "fleet-coverage": fleet_coverage.measure,
    "accelerator": accelerator.measure,
    "memory": population.measure_memory,
    "files": files.measure,
    "unknown-plants": unknown_plants.measure,
    "wider-plants": wider_plants.measure,
    "adaptive-gains": adaptive_gains.measure,
}
"""By the name on the command line, in the order in which they run."""
