"""The command `tolerance`: a population of actuators through the experiments, and what comes of its spread."""

import pathlib
import time

import numpy as np

from vgtjax.errors import SimulationError
from vgtjax.population import Evaluator

from ..console import console
from ..files import write_json, write_text
from ..population import ChunkStore, PopulationJob, claim_together, leads, meet, prepare_population, sweep
from .report import render
from .samples import choose_sample, write_samples
from .summary import Known, check_limits, summarise


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json`, `samples.npz` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `InputError` before anything is written; `SimulationError` when every sample failed, after everything
    else is written.
    """
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
    sample = choose_sample(job)
    if not claim_together(out, "tolerance", job.fingerprint):
        return
    for note in job.notes:
        console.print(f"note: {note}")
    began = time.monotonic()
    store = ChunkStore(out, evaluator.columns, table.samples, min(table.lanes, table.samples))
    known = known_actuators(job, evaluator)
    sweep(evaluator, job.population, sample, store, range(len(evaluator.columns)), "tolerance")
    if leads():
        seconds = time.monotonic() - began
        summary = summarise(job, sample, store, known, evaluator.outputs, seconds)
        write_samples(out / "samples.npz", job, sample, store, evaluator.outputs)
        write_json(out / "summary.json", summary)
        write_text(out / "report.html", render(job, store, known, evaluator.outputs, summary))
        store.remove()
        console.print(f"report: {(out / 'report.html').resolve()}")
        if summary["failed"]["count"] == table.samples:
            raise SimulationError(
                "every sample's simulation failed; narrow the tolerances, or check the nominal values"
            )
    meet()


def known_actuators(job: PopulationJob, evaluator: Evaluator) -> Known:
    """The experiments on the nominal actuator and on each fitted unit."""
    factors = job.population.factors
    models = [job.population.model, *job.fitted.values()]
    results = evaluator(np.stack([np.asarray(factors.pack(model)) for model in models]))
    readings = [dict(zip(evaluator.columns, row, strict=True)) for row in results.outputs.tolist()]
    return Known(readings[0], dict(zip(job.fitted, readings[1:], strict=True)))
