"""The command `sensitivity`: which quantity's spread each output comes from, by every index, with intervals."""

import pathlib
import time
from typing import Any

import numpy as np

from vgtjax import SimulationError
from vgtjax.parts import without_chatter
from vgtjax.population import Evaluator
from vgtjax.sensitivity import RadialDesign

from ..output.console import console
from ..output.files import read_json, write_json, write_text
from ..population import (
    ChunkStore,
    PopulationJob,
    agree,
    claim_together,
    leads,
    meet,
    prepare_population,
    sweep,
    together,
)
from .analysis import analyse_all, chosen_outputs
from .report import render
from .summary import summarise


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `InputError` before anything is written; `SimulationError` when too many samples failed for any index.
    """
    job, evaluator, design = together(lambda: _plan(study, parameters))
    if claim_together(out, "sensitivity", job.fingerprint):
        _compute(job, evaluator, design, out)
    if agree(leads() and not _has_indices(read_json(out / "summary.json"))):
        raise SimulationError(
            "too many simulations failed for any index; narrow the spreads, or raise base under [sensitivity]"
        )


def _plan(study: pathlib.Path | None, parameters: pathlib.Path | None) -> tuple[PopulationJob, Evaluator, RadialDesign]:
    job = prepare_population(study, parameters, levels=True)
    table, population = job.study.sensitivity, job.population
    design = RadialDesign(population.dimensions, table.base, table.seed)
    lanes = min(table.lanes, design.rows)
    return job, Evaluator(population.model, population.factors, job.experiments, lanes=lanes), design


def _compute(job: PopulationJob, evaluator: Evaluator, design: RadialDesign, out: pathlib.Path) -> None:
    """Simulates what is missing, and writes the results."""
    for note in job.notes:
        console.print(f"note: {note}")
    began, table, population = time.monotonic(), job.study.sensitivity, job.population
    outputs = chosen_outputs(evaluator.outputs)
    names = {output.name for output in outputs}
    keep = [place for place, column in enumerate(evaluator.columns) if column.partition("[")[0] in names]
    columns = tuple(evaluator.columns[place] for place in keep)
    store = ChunkStore(out, columns, design.rows, min(table.lanes, design.rows), len(columns), design.rows)
    sweep(evaluator, population, design, store, keep, "sensitivity")
    with console.status("exact gradients"):
        points = np.concatenate([population.nominal[None], _base_values(job, design)])
        smooth = Evaluator(without_chatter(population.model), population.factors, job.experiments, lanes=table.lanes)
        gradients = smooth.gradient(points)[:, keep]
    if leads():
        with console.status("indices"):
            analysis = analyse_all(job, design, store, outputs, gradients)
        summary = summarise(job, design, analysis, time.monotonic() - began)
        write_json(out / "summary.json", summary)
        write_text(out / "report.html", render(job, analysis, summary))
        store.remove()
        console.print(f"report: {(out / 'report.html').resolve()}")
    meet()


def _has_indices(summary: dict[str, Any]) -> bool:
    return any(
        row["total"]["value"] is not None for output in summary["outputs"].values() for row in output["quantities"]
    )


def _base_values(job: PopulationJob, design: RadialDesign) -> np.ndarray:
    """The first base points, at which derivatives are averaged."""
    a, _ = design.base_points(0, min(job.study.sensitivity.gradient_points, design.base))
    return job.population.values(a)
