"""The command `tolerance`: a population of actuators through the experiments, and what comes of its spread."""

import pathlib
import time

import numpy as np

from vgtjax import SimulationError
from vgtjax.population import Evaluator

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
from .report import render
from .samples import CURVES, choose_sample, write_samples
from .summary import Known, check_limits, summarise


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json`, `samples.npz` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `InputError` before anything is written; `SimulationError` when every sample failed, after everything
    else is written.
    """
    job, evaluator = together(lambda: _plan(study, parameters))
    if claim_together(out, "tolerance", job.fingerprint):
        _compute(job, evaluator, out)
    if agree(leads() and read_json(out / "summary.json")["failed"]["count"] == job.study.tolerance.samples):
        raise SimulationError("every sample's simulation failed; narrow the tolerances, or check the nominal values")


def _plan(study: pathlib.Path | None, parameters: pathlib.Path | None) -> tuple[PopulationJob, Evaluator]:
    job = prepare_population(study, parameters, levels=False)
    table = job.study.tolerance
    evaluator = Evaluator(
        job.population.model,
        job.population.factors,
        job.experiments,
        lanes=min(table.lanes, table.samples),
        dtype=np.float64 if table.precision == "double" else np.float32,
    )
    check_limits(evaluator.outputs, table.limits)
    return job, evaluator


def _compute(job: PopulationJob, evaluator: Evaluator, out: pathlib.Path) -> None:
    """Simulates what is missing, and writes the results."""
    for note in job.notes:
        console.print(f"note: {note}")
    began, table, outputs = time.monotonic(), job.study.tolerance, evaluator.outputs
    numbers = [place for place, column in enumerate(evaluator.columns) if "[" not in column]
    keep = [*numbers, *[place for place in range(len(evaluator.columns)) if place not in set(numbers)]]
    columns = tuple(evaluator.columns[place] for place in keep)
    store = ChunkStore(out, columns, table.samples, min(table.lanes, table.samples), len(numbers), CURVES)
    known = known_actuators(job, evaluator)
    sample = choose_sample(job)
    sweep(evaluator, job.population, sample, store, keep, "tolerance")
    if leads():
        summary = summarise(job, sample, store, known, outputs, time.monotonic() - began)
        write_samples(out / "samples.npz", job, sample, store, outputs)
        write_json(out / "summary.json", summary)
        write_text(out / "report.html", render(job, store, known, outputs, summary))
        store.remove()
        console.print(f"report: {(out / 'report.html').resolve()}")
    meet()


def known_actuators(job: PopulationJob, evaluator: Evaluator) -> Known:
    """The experiments on the nominal actuator and on each fitted unit."""
    factors = job.population.factors
    models = [job.population.model, *job.fitted.values()]
    results = evaluator(np.stack([np.asarray(factors.pack(model)) for model in models]))
    readings = [dict(zip(evaluator.columns, row, strict=True)) for row in results.outputs.tolist()]
    return Known(readings[0], dict(zip(job.fitted, readings[1:], strict=True)))
