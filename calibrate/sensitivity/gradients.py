"""Exact derivatives at the nominal actuator and the first samples, part by part, so that a run resumes among them."""

import math

import numpy as np

from vgtjax.parts import without_chatter
from vgtjax.population import Evaluator, OutputTable
from vgtjax.sensitivity import RadialDesign

from ..output.console import console
from ..population import ChunkStore, Plan
from ..processes import agree, leads


def find_gradients(plan: Plan, design: RadialDesign, store: ChunkStore) -> OutputTable | None:
    """Derivatives of all outputs at the nominal actuator first, then at the base points over which they are averaged;
    in the first process only."""
    table, population = plan.job.study.sensitivity, plan.job.population
    a, _ = design.base_points(0, min(table.gradient_points, design.base))
    points = np.concatenate([population.nominal[None], population.values(a)])
    model = without_chatter(population.model)
    evaluator = Evaluator(model, population.factors, plan.job.experiments, lanes=table.lanes)
    # Parts of one size, which share a program; the last one is filled up with points that are there already.
    count = math.ceil(len(points) * points.shape[1] / table.lanes)
    parts = np.resize(points, (count, math.ceil(len(points) / count), points.shape[1]))
    done = agree(np.array([store.has_slopes(number) for number in range(count)]))
    if np.any(done):
        console.print(f"resuming with {np.sum(done)} of {count} parts of the gradients done")
    failures: list[str] = []
    with console.status("exact gradients"):
        for number in np.flatnonzero(~done).tolist():
            slopes = evaluator.gradient(parts[number])
            if slopes.failed.any():
                failures.append(slopes.failure)
            if leads():
                store.save_slopes(number, slopes.matrix)
    if failures:
        console.print(f"note: some actuators have no derivatives, as their simulation failed. {failures[0]}")
    if not leads():
        return None
    matrix = np.concatenate([store.load_slopes(number) for number in range(count)])
    return OutputTable(evaluator.outputs, matrix[: len(points)])
