"""The command `control`: closes the loops of a study with given gains, and says what they are worth."""

import pathlib
import time

from vgtjax import SimulationError
from vgtjax.tuning import close_loops, sliding_margins

from ..fmu.cost import cost_on_target
from ..output.console import console
from ..output.files import REPORT, SUMMARY, read_json, write_json, write_text
from ..output.margins import least_margins
from ..resumable import run_once
from .job import ControlJob, prepare_control
from .outcome import Outcome, look_at, slides, summarise, tabulate
from .report import render
from .terminal import table
from .traces import trace_csv, trace_name

TRACES = "traces"


def run(
    study: pathlib.Path | None, parameters: pathlib.Path | None, gains: pathlib.Path | None, out: pathlib.Path
) -> None:
    """Writes `summary.json`, `report.html`, and a CSV for every closed loop under `traces/`.

    **Raises:** `SimulationError` after everything is written, when a closed loop failed.
    """
    job = prepare_control(study, parameters, gains)
    run_once(out, "control", job.fingerprint, lambda: _compute(job, out))
    summary = read_json(out / SUMMARY)
    if failed := summary["failed"]:
        raise SimulationError(
            f"{len(failed)} closed loops fail, the first of them '{failed[0]}'; lower its gains. {summary['failure']}"
        )


def _compute(job: ControlJob, out: pathlib.Path) -> None:
    for note in job.notes:
        console.print(f"note: {note}")
    table_of = job.study.control
    began, groups = time.monotonic(), []
    for cases in job.groups:
        with console.status(f"{len(cases)} closed loops of {cases.duration:.4g} s"):
            groups.append(close_loops(job.controllers, cases, settled=table_of.settled, lanes=table_of.lanes))
    first = job.controllers[job.groups[0].labels[0].plant]
    used, sample_seconds = look_at(first, job.groups[0])
    with console.status("writing the controller as C"):
        sample = cost_on_target(first, table_of.period)
    with console.status("linearising the loops"):
        margins = sliding_margins(job.controllers, job.groups[0], lanes=table_of.lanes)
    seen = slides(job, tuple(groups))
    outcome = Outcome(tuple(groups), margins, seen, used, sample_seconds, sample, time.monotonic() - began)
    rows, summary = tabulate(outcome), summarise(job, outcome)
    took = f"{1e6 * sample_seconds:.3g} us per sample"
    console.print(f"{table_of.design} knows {job.belief}; it measures {', '.join(summary['measures'])}; {took} here")
    console.print(table(rows))
    if seen is not None:
        console.print(seen.sentence if seen.slides else f"warning: {seen.sentence}")
    console.print(least_margins(margins))
    write_json(out / SUMMARY, summary)
    _write_traces(outcome, out / TRACES)
    with console.status("writing the report"):
        write_text(out / REPORT, render(job, outcome, rows, summary))


def _write_traces(outcome: Outcome, folder: pathlib.Path) -> None:
    folder.mkdir(exist_ok=True)
    for number, (group, index) in enumerate(outcome.loops, 1):
        write_text(folder / trace_name(number, group.labels[index]), trace_csv(group, index))
