"""The command `sensitivity`: which quantity's spread each output comes from, by every index, with intervals."""

import pathlib
from typing import Any

from vgtjax import SimulationError
from vgtjax.population import Evaluator, OutputTable
from vgtjax.sensitivity import RadialDesign

from ..output.console import console
from ..output.files import REPORT, SUMMARY, read_json, write_json, write_text
from ..population import ChunkStore, Plan, carry_out, prepare_population
from ..processes import agree, leads, together
from .analysis import analyse_all, chosen_outputs
from .gradients import find_gradients
from .report import render
from .summary import sample_note, summarise
from .terminal import lines


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json` and `report.html`; goes on where an earlier run was interrupted.

    **Raises:** `SimulationError` when too many samples failed for any index.
    """
    plan, design = together(lambda: _plan(study, parameters))

    def write(store: ChunkStore, gradients: OutputTable | None, seconds: float) -> None:
        assert gradients is not None  # it is the first process that writes
        with console.status("indices"):
            analysis = analyse_all(plan.job, design, store, gradients)
        summary = summarise(plan.job, design, analysis, seconds)
        for note in sample_note(analysis):
            console.print(f"note: {note}")
        for line in lines(summary):
            console.print(line)
        write_json(out / SUMMARY, summary)
        write_text(out / REPORT, render(plan.job, analysis, summary))

    carry_out(plan, out, "sensitivity", lambda store: find_gradients(plan, design, store), write)
    if agree(leads() and not _has_indices(read_json(out / SUMMARY))):
        raise SimulationError(
            "too many simulations failed for any index; narrow the spreads, or raise base under [sensitivity]"
        )


def _plan(study: pathlib.Path | None, parameters: pathlib.Path | None) -> tuple[Plan, RadialDesign]:
    job = prepare_population(study, parameters, levels=True)
    table, population = job.study.sensitivity, job.population
    design = RadialDesign(population.dimensions, table.base, table.seed)
    lanes = min(table.lanes, design.rows)
    evaluator = Evaluator(population.model, population.factors, job.experiments, lanes=lanes)
    return Plan(job, evaluator, design, chosen_outputs(evaluator.outputs), design.rows, lanes), design


def _has_indices(summary: dict[str, Any]) -> bool:
    return any(
        row["total"]["value"] is not None for output in summary["outputs"].values() for row in output["quantities"]
    )
