"""The command `sensitivity`: which quantity's spread each output comes from, by every index, with intervals."""

import dataclasses
import pathlib
import time
from typing import Any

import equinox as eqx
import numpy as np

from vgtjax.errors import SimulationError
from vgtjax.population import Evaluator
from vgtjax.sensitivity import RadialDesign

from ..console import console
from ..files import write_json, write_text
from ..population import ChunkStore, PopulationJob, claim_together, leads, meet, prepare_population, sweep
from .analysis import analyse_all, chosen_outputs
from .report import render
from .summary import summarise

OPENING = 1e-5
"""m of lift over which the atmosphere's orifice opens where derivatives are taken. At the default 1 um some actuators
chatter as they release: that moves no output by more than a pascal, but so finely that a derivative sees nothing else
(580 Pa instead of 5 Pa of loop width by the level of that orifice, of the twenty units' mean). At 10 um widths are
within 0.2 Pa."""


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `InputError` before anything is written; `SimulationError` when too many samples failed for any index.
    """
    job = prepare_population(study, parameters, levels=True)
    table = job.study.sensitivity
    population = job.population
    evaluator = Evaluator(population.model, population.factors, job.experiments, lanes=table.lanes)
    design = RadialDesign(population.dimensions, table.base, table.seed)
    if not claim_together(out, "sensitivity", job.fingerprint):
        return
    for note in job.notes:
        console.print(f"note: {note}")
    began = time.monotonic()
    outputs = chosen_outputs(evaluator.outputs)
    keep = [place for place, column in enumerate(evaluator.columns) if _owner(column) in {o.name for o in outputs}]
    store = ChunkStore(out, tuple(evaluator.columns[place] for place in keep), design.rows, table.lanes)
    sweep(evaluator, population, design, store, keep, "sensitivity")
    with console.status("exact gradients"):
        points = np.concatenate([population.nominal[None], _base_values(job, design)])
        smooth = Evaluator(_without_chatter(population.model), population.factors, job.experiments, lanes=table.lanes)
        gradients = smooth.gradient(points)[:, keep]
    if leads():
        with console.status("indices"):
            analysis = analyse_all(job, design, store, outputs, gradients)
        summary = summarise(job, design, analysis, time.monotonic() - began)
        write_json(out / "summary.json", summary)
        write_text(out / "report.html", render(job, analysis, summary))
        store.remove()
        console.print(f"report: {(out / 'report.html').resolve()}")
        if not np.any(analysis.indices.used):
            raise SimulationError(
                f"{len(analysis.failed)} of {design.rows} simulations failed, which leaves no index; narrow the spreads"
            )
    meet()


def _owner(column: str) -> str:
    return column.partition("[")[0]


def _without_chatter(model: Any) -> Any:
    return eqx.tree_at(lambda m: m.converter, model, dataclasses.replace(model.converter, opening_width=OPENING))


def _base_values(job: PopulationJob, design: RadialDesign) -> np.ndarray:
    """The first base points, at which derivatives are averaged."""
    a, _ = design.base_points(0, min(job.study.sensitivity.gradient_points, design.base))
    return job.population.values(a)
