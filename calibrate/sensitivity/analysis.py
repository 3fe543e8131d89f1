"""All indices of a sensitivity study, from the simulations that were made."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from vgtjax.control import POSITION_NOISE, PRESSURE_NOISE
from vgtjax.experiments import Output
from vgtjax.population import OutputTable, column_names
from vgtjax.sensitivity import (
    Indices,
    RadialDesign,
    Rankings,
    analyse,
    complete_groups,
    gradient_share,
    rank_inputs,
    squared_correlation,
    total_bound,
    variance,
)

from ..population import ChunkStore, PopulationJob

NOISE = {"m": POSITION_NOISE, "Pa": PRESSURE_NOISE}
"""Of the sensors of position and pressure; shares of a smaller spread, as of a rod at rest, are of no use."""
BLOCK = 2**22
"""Numbers of results that are read at a time, 32 MiB."""


@dataclasses.dataclass(frozen=True, eq=False)
class Analysis:
    """All that was found; rows of the indices are the columns of all outputs, of numbers first, then of curves."""

    outputs: tuple[Output, ...]
    indices: Indices
    local: np.ndarray
    bound: np.ndarray
    rankings: Rankings
    """Of the outputs that are numbers."""
    failed: dict[int, str]
    rows: int
    deviation: np.ndarray
    """Standard deviation of every column, in SI units."""
    sample_correlation: float
    """Largest squared correlation that two quantities happen to have in the sample; (4.1) sees it as an effect."""

    def above_noise(self, output: Output, shares: np.ndarray) -> np.ndarray:
        """Shares `(columns, quantities)` of one output; NaN where its spread is below the noise of its sensor."""
        place = self.indices.place(output.name)
        return np.where(self.deviation[place, None] > NOISE[output.unit], shares[place], np.nan)


def chosen_outputs(outputs: tuple[Output, ...]) -> tuple[Output, ...]:
    """Numbers, and curves over time; the branches of loops say again what the numbers say."""
    numbers = tuple(output for output in outputs if not output.axis)
    return numbers + tuple(output for output in outputs if output.axis_unit == "s")


def analyse_all(job: PopulationJob, design: RadialDesign, store: ChunkStore, gradients: OutputTable) -> Analysis:
    """Every index of every output.

    **Arguments:** `gradients`: at the nominal actuator and at some base points, `(points, columns, quantities)`.
    """
    table, population, outputs = job.study.sensitivity, job.population, store.outputs
    x = population.values(design.points(0, design.rows))
    slopes = gradients.select(outputs).matrix
    parts, variances = [], list[float]()
    settings: dict[str, Any] = {"replicates": table.replicates, "level": table.confidence, "seed": table.seed}
    for names, y in _columns(store):
        parts.append(analyse(design, x, y, inputs=population.factors.entries, outputs=names, **settings))
        variances += [_variance(column[np.isfinite(column)]) for column in y.T]
    indices, spread = Indices.joined(parts), np.array(variances)
    local = gradient_share(slopes[0], population.deviations)
    bound = _bounds(slopes[1:], population.deviations, spread)
    numbers = [output.name for output in store.numbers]
    rankings = rank_inputs(indices.select(numbers), local=local[: len(numbers)], threshold=table.threshold)
    together = squared_correlation(x, x)
    np.fill_diagonal(together, 0.0)
    return Analysis(
        outputs,
        indices,
        local,
        bound,
        rankings,
        store.failed(),
        design.rows,
        np.sqrt(spread),
        float(together.max()),
    )


def _variance(values: np.ndarray) -> float:
    return float(variance(values[:, None])[0]) if len(values) > 1 else np.nan


def _bounds(gradients: np.ndarray, deviations: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Derivative-based measure of every column, over the points at which that column has a derivative."""
    bound = np.full(gradients.shape[1:], np.nan)
    for points, columns in complete_groups(np.isfinite(gradients).all(axis=2)):
        if len(points):
            bound[columns] = total_bound(gradients[np.ix_(points, columns)], deviations, variances[columns], 1.0)
    return bound


def _columns(store: ChunkStore) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """All columns of all rows with their names, a block at a time: all curves of a large study need no memory."""
    names, width = column_names(store.outputs), max(1, BLOCK // store.rows)
    for first in range(0, len(names), width):
        block = names[first : first + width]
        yield block, store.columns(block)
