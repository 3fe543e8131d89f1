"""What summaries and reports say of a population: outputs in the units of the bench, quantities, failed samples."""

import itertools
from typing import Any, NamedTuple

from vgtjax.experiments import Output
from vgtjax.population import Population, Sample

from ..output.files import finite
from .job import PopulationJob

NAMED = 100
"""Failed samples that a summary names with their values; more of them say no more."""
AT_ONCE = 65536
"""Samples whose friction is looked at together."""


class Scaled(NamedTuple):
    """The units in which an output is shown, and the factors to them from SI."""

    unit: str
    factor: float
    axis_unit: str
    axis_factor: float


_SHOWN = {"Pa": ("mbar", 1e-2), "s": ("ms", 1e3), "m": ("mm", 1e3), "": ("", 1.0)}


def scaled(output: Output) -> Scaled:
    """The units of the bench: mbar, ms, mm."""
    axis = ("s", 1.0) if output.axis_unit == "s" else _SHOWN[output.axis_unit]
    return Scaled(*_SHOWN[output.unit], *axis)


def describe_failed(job: PopulationJob, sample: Sample, failed: dict[int, str]) -> dict[str, Any]:
    """How many samples failed; row numbers, causes and values of the first of them."""
    entries, named = job.population.factors.entries, []
    for row, cause in itertools.islice(failed.items(), NAMED):
        values = job.population.values(sample.points(row, row + 1))[0].tolist()
        by_name = {entry: finite(value) for entry, value in zip(entries, values, strict=True)}
        named.append({"sample": row, "cause": cause, "values": by_name})
    return {"count": len(failed), "samples": named}


def describe_active(population: Population, sample: Sample) -> dict[str, Any]:
    """How many samples have friction that, as drawn, could give out energy, and whether those were raised."""
    begins = range(0, sample.rows, AT_ONCE)
    count = sum(int(population.active(sample.points(i, min(i + AT_ONCE, sample.rows))).sum()) for i in begins)
    return {"count": count, "raised": population.passive}


def say_active(population: Population, count: int, samples: int) -> str | None:
    """A sentence on samples whose friction, as drawn, could give out energy, and on what was done about it."""
    if not count:
        return None
    raised = (
        "; the viscous damping of such a sample was raised to the least of passive friction (passive = false under "
        "[population] leaves it)"
    )
    done = raised if population.passive else ""
    return f"{count:,} of {samples:,} samples had friction that, as drawn, could give out energy{done}"


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
