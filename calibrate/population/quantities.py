"""What summaries say of the quantities that vary, and of samples that failed."""

import itertools
from typing import Any

from vgtjax.population import Sample

from .job import PopulationJob
from .outputs import finite

NAMED = 100
"""Failed samples that a summary names with their values; more of them say no more."""


def describe_failed(job: PopulationJob, sample: Sample, failed: dict[int, str]) -> dict[str, Any]:
    """How many samples failed; row numbers, causes and values of the first of them."""
    entries, named = job.population.factors.entries, []
    for row, cause in itertools.islice(failed.items(), NAMED):
        values = job.population.values(sample.points(row, row + 1))[0].tolist()
        by_name = {entry: finite(value) for entry, value in zip(entries, values, strict=True)}
        named.append({"sample": row, "cause": cause, "values": by_name})
    return {"count": len(failed), "samples": named}


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
