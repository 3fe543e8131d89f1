"""What summaries say of the quantities that vary, and of samples that failed."""

import itertools
from typing import Any

from vgtjax.population import Sample

from ..output.files import finite
from .job import PopulationJob

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
    """Unit, distribution, nominal value, mean and deviation of everything that varies."""
    population = job.population
    units = population.factors.units(population.model)
    columns = (population.factors.entries, units, population.nominal.tolist(), population.margins)
    return {
        entry: {
            "unit": unit,
            "distribution": type(margin.dist).__name__.removesuffix("_gen"),
            "nominal": nominal,
            "mean": finite(margin.mean()),
            "deviation": finite(margin.std()),
        }
        for entry, unit, nominal, margin in zip(*columns, strict=True)
    }
