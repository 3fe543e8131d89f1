"""The command `identify`: the bench tests of chapters 2 and 3 that the traces allow, one after the other."""

import functools
import pathlib
import time
from typing import Any

import numpy as np

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import Estimate, TraceResult, compare, plan_task
from vgtjax.identification import Identified, identify
from vgtjax.parameters import move_inside, table_row
from vgtjax.plants import AbstractRodModel

from ..output.console import console
from ..output.files import REPORT, SUMMARY, finite, write_json, write_text
from ..output.sections import model_sections, trace_summary
from ..resumable import Folders, run_units
from ..study.parameter_file import by_entry, tabulate, to_json
from ..study.units import Job, Unit, prepare
from ..workers import each_unit
from .report import render, render_overview


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `parameters.json`, `summary.json` and `report.html`; with units, a folder each and the whole on top.

    The traces with use = 'fit' are used; all of them are compared with the model that comes out. Units that an
    earlier run of the same study has finished are kept.

    **Raises:** `SimulationError` when nothing could be identified, after everything else is written.
    """
    job = prepare(study, parameters, to_fit=True, as_recorded=True)
    compute, overview = functools.partial(_identify_units, job), functools.partial(render_overview, job)
    summaries = run_units(job, out, "identify", compute, overview)
    empty = [name or "this study" for name, summary in summaries.items() if not summary["identified"]]
    if empty:
        units = ", ".join(empty)
        raise SimulationError(f"the traces of {units} allow no identification; the report says what is missing")


def _identify_units(job: Job, folders: Folders) -> None:
    each_unit(job, folders, _identify_unit)


def _identify_unit(job: Job, unit: Unit, folder: pathlib.Path) -> None:
    began = time.monotonic()
    model, found = unit.model, []
    with console.status(f"{unit.name or 'identify'}: reading the traces") as status:
        assert isinstance(model, AbstractRodModel)  # as every model of a study is
        for updated, result in identify(model, unit.used("fit")):
            model = updated
            found.append(result)
            why = "; ".join(result.limitations)
            outcome = f"{len(result.values)} parameters" if result.values else f"not possible: {why}"
            who = "" if unit.name is None else f"{unit.name}: "
            console.print(f"{who}{result.name} [{result.equations}]: {outcome}")
        status.update("simulating all traces")
        model = move_inside(model, unit.bounds)  # so that a fit can start from it
        traces = compare(plan_task(model, unit.used("fit"), unit.used("validate"), free=[]), model)
    for each in traces:
        if each.failed:
            console.print(f"the simulation of {each.trace.name} with these values failed: {each.failure}")
    seconds = time.monotonic() - began
    table = tabulate(unit.model, model, _estimates(model, found, unit), unit.bounds)
    write_json(folder / "parameters.json", to_json(job.study, table))
    write_json(folder / SUMMARY, _summary(found, traces, seconds, job))
    page = render(job, unit.name, found, table, seconds, model_sections(model, traces))
    write_text(folder / REPORT, page)


def _estimates(model: vgtjax.AbstractModel, found: list[Identified], unit: Unit) -> dict[str, Estimate]:
    """Standard errors by entry, of the last test that determined each."""
    table, every = vgtjax.parameter_table(model), vgtjax.select(model, free=["*"])
    values = dict(zip(every.entries, every.values(model).tolist(), strict=True))
    return {
        entry: Estimate(
            values[entry],
            str(table_row(table, entry).unit),
            float(error),
            at_bound=values[entry] in unit.bounds.get(entry, (None, None)),
            determined=bool(np.isfinite(error)),
        )
        for result in found
        for entry, error in by_entry(result.std_errors).items()
        if entry in values
    }


def _summary(found: list[Identified], traces: list[TraceResult], seconds: float, job: Job) -> dict[str, Any]:
    return {
        "identified": sorted({name for result in found for name in result.values}),
        **job.account(seconds),
        "sections": [_section(result) for result in found],
        "traces": {result.trace.name: trace_summary(result) for result in traces},
    }


def _section(result: Identified) -> dict[str, Any]:
    return {
        "name": result.name,
        "equations": result.equations,
        "method": result.method,
        "samples": result.samples,
        "values": {name: np.asarray(value).tolist() for name, value in result.values.items()},
        "std_errors": finite(result.std_errors),
        "unseen": list(result.limitations),
    }
