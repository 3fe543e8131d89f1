"""A population through some experiments, in one call."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..experiments import AbstractExperiment
from ..simulation import FixedStep
from ._evaluate import LANES, Evaluator
from ._population import Population
from ._results import Results
from ._sampling import make_sample


def run(
    population: Population,
    experiments: Sequence[AbstractExperiment],
    samples: int = 1024,
    *,
    sampler: str = "sobol",
    seed: int = 0,
    lanes: int = LANES,
    stepping: FixedStep | None = None,
    dtype: Any = np.float64,
) -> Results:
    """Monte Carlo: what the experiments read off actuators drawn from a population.

        population = vgtjax.population.spread_population(vgtjax.Actuator(), relative=0.02)
        results = vgtjax.population.run(population, [vgtjax.experiments.SlowLoop()], samples=256)
        results["hysteresis_0mbar"]  # (256,), Pa

    The same samples as those of the command `tolerance`, on any number of devices.

    **Arguments:**

    - `samples`, `sampler`, `seed`: as in [`make_sample`][vgtjax.population.make_sample]; powers of two are best.
    - `lanes`, `stepping`, `dtype`: as in [`Evaluator`][vgtjax.population.Evaluator].

    **Raises:** `InputError` for a sample or an experiment that can't be.
    """
    sample = make_sample(population.dimensions, samples, sampler, seed)
    lanes = min(lanes, samples)
    evaluator = Evaluator(
        population.model, population.factors, experiments, lanes=lanes, stepping=stepping, dtype=dtype
    )
    return evaluator(population.values(sample.points(0, samples)))
