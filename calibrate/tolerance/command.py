"""The command `tolerance`: a population of actuators through the experiments, and what comes of its spread."""

import pathlib

import numpy as np

from vgtjax import SimulationError
from vgtjax.population import Evaluator, Factors, Results, differing_factors, make_sample

from ..output.console import say
from ..output.files import REPORT, SUMMARY, read_json, write_json, write_text
from ..population import ChunkStore, Plan, PopulationJob, carry_out, prepare_population
from ..processes import agree, leads, together
from ..study.places import of_study
from .report import render
from .samples import CURVES, write_samples
from .summary import check_limits, summarise
from .terminal import share, table


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json`, `samples.npz` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `SimulationError` when every sample failed, after everything else is written.
    """
    plan = together(lambda: _plan(study, parameters))

    def write(store: ChunkStore, known: Results, seconds: float) -> None:
        summary = summarise(plan, store, known, seconds)
        say(table(summary))
        if summary["yield"]:
            say(f"all limits are kept by {share(summary['yield'])}")
        write_samples(out / "samples.npz", plan, store)
        write_json(out / SUMMARY, summary)
        write_text(out / REPORT, render(plan.job, store, known, summary))

    carry_out(plan, out, "tolerance", lambda _: known_actuators(plan), write)
    if agree(leads() and read_json(out / SUMMARY)["failed"]["count"] == plan.sample.rows):
        raise SimulationError("every sample's simulation failed; narrow the tolerances, or check the nominal values")


def _plan(study: pathlib.Path | None, parameters: pathlib.Path | None) -> Plan:
    job = prepare_population(study, parameters, levels=False)
    table, population = job.study.tolerance, job.population
    sample = make_sample(population.dimensions, table.samples, table.sampler, table.seed)
    lanes = min(table.lanes, table.samples)
    evaluator = _evaluator(job, population.factors, lanes)
    with of_study():
        check_limits(evaluator.outputs, table.limits)
    return Plan(job, evaluator, sample, evaluator.outputs, CURVES, lanes)


def _evaluator(job: PopulationJob, factors: Factors, lanes: int) -> Evaluator:
    dtype = np.float64 if job.study.tolerance.precision == "double" else np.float32
    return Evaluator(job.population.model, factors, job.experiments, lanes=lanes, dtype=dtype)


def known_actuators(plan: Plan) -> Results:
    """The experiments on the nominal actuator and on each fitted unit, as it was fitted, which are no samples."""
    models = [plan.job.population.model, *plan.job.fitted.values()]
    factors, apart = plan.job.population.factors, differing_factors(models)
    if set(apart.entries) <= set(factors.entries) and all(factors.restores(model) for model in models):
        evaluator = plan.evaluator
    else:  # what no unit determines, or not all of them have free, is no quantity of the population, nor made passive
        factors, evaluator = apart, _evaluator(plan.job, apart, len(models))
    return evaluator(np.stack([np.asarray(factors.pack(model)) for model in models]))
