"""What summaries say of the quantities that vary, and of samples that failed."""

from typing import Any

import numpy as np

from vgtjax.sensitivity import Sample

from .job import PopulationJob
from .outputs import finite

NAMED = 100
"""Failed samples that a summary names with their values; more of them say no more."""


def describe_failed(job: PopulationJob, sample: Sample, failed: np.ndarray) -> list[dict[str, Any]]:
    """Row numbers of the first failed samples, and their values."""
    entries, named = job.population.factors.entries, []
    for row in failed[:NAMED].tolist():
        values = job.population.values(sample.points(row, row + 1))[0].tolist()
        named.append({"sample": row, "values": {e: finite(v) for e, v in zip(entries, values, strict=True)}})
    return named


def describe_quantities(job: PopulationJob) -> dict[str, Any]:
    """Unit, nominal value, mean and deviation of everything that varies."""
    population = job.population
    units = population.factors.units(population.model)
    return {
        entry: {"unit": unit, "nominal": nominal, "mean": finite(margin.mean()), "deviation": finite(margin.std())}
        for entry, unit, nominal, margin in zip(
            population.factors.entries, units, population.nominal.tolist(), population.margins, strict=True
        )
    }
