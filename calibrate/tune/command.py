"""The command `tune`: gains by the exact gradient of their closed loops, resumably, with a report."""

import pathlib

import numpy as np

from vgtjax import SimulationError
from vgtjax.tuning import Tuner, TuningProgress, conditions_asked

from ..fmu.cost import cost_on_target
from ..output.console import console
from ..output.files import REPORT, SUMMARY, read_json, write_json, write_text
from ..output.margins import least_margins
from ..processes import leads, meet, together
from ..resumable import ProgressFile, run_once
from ..study.parameter_file import Entry
from .fallback import fallback_of, with_fallback
from .gains_file import NAME, gains_json
from .job import TuneJob, prepare_tuning
from .outcome import Outcome, compare, gain_entries, summarise
from .report import render


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `gains.json`, `summary.json` and `report.html`; goes on where an earlier run was interrupted.

    Several processes share the closed loops, and the folder.

    **Raises:** `SimulationError` when the start's closed loops fail, and, after everything is written, when tuning did
    not converge or tuned gains fail in a true closed loop.
    """
    job = together(lambda: prepare_tuning(study, parameters))
    run_once(out, "tune", job.fingerprint, lambda: _compute(job, out))
    meet()
    if leads():
        _verdict(read_json(out / SUMMARY))


def _compute(job: TuneJob, out: pathlib.Path) -> None:
    for note in job.notes:
        console.print(f"note: {note}")
    console.print(f"{len(job.smooth.cases)} closed loops, {len(job.smooth.selection.entries)} free gains")
    progress, seconds = _tune(job, out)
    with console.status("simulating all closed loops"):
        outcome = compare(job, progress, seconds)
    for what, loops in (("tuned on", outcome.true), ("unseen", outcome.unseen)):
        before, after = loops.costs
        console.print(f"cost of the loops {what}: {before:.4g} before, {after:.4g} after")
    for remark in outcome.remarks:
        console.print(f"warning: {remark}")
    if outcome.sliding is not None and outcome.sliding.slides:
        console.print(outcome.sliding.sentence)
    console.print(least_margins(outcome.margins))
    entries = gain_entries(job, outcome.coordinates)
    if leads():
        _write(job, out, outcome, entries)


def _write(job: TuneJob, out: pathlib.Path, outcome: Outcome, entries: list[Entry]) -> None:
    """The files, the report last."""
    tuned = job.true.controller_at(outcome.coordinates)
    with console.status("writing the controller as C"):
        controller = with_fallback(fallback_of(job.study), job.believed, tuned)
        sample = cost_on_target(controller, job.study.control.period)
    summary = summarise(job, outcome, conditions_asked(tuned), sample)
    write_json(out / NAME, gains_json(job.study, entries, job.believed))
    write_json(out / SUMMARY, summary)
    with console.status("writing the report"):
        write_text(out / REPORT, render(job, outcome, entries, summary))
    ProgressFile.remove_from(out)


def _tune(job: TuneJob, folder: pathlib.Path) -> tuple[TuningProgress, float]:
    """Tunes, keeping the progress on disk; also the seconds it took."""
    saved = ProgressFile(folder, TuningProgress, "tuning")
    with console.status("compiling the closed loops and their derivatives"):
        tuner = Tuner(job.smooth, saved.progress)
    console.print(f"{'step':>6} {'by':>11} {'cost':>12} {'worst um':>10} {'trials':>7} {'exact':>9} {'seconds':>8}")
    _show(tuner, saved.seconds)
    while not tuner.progress.finished:
        before = tuner.progress.iteration
        with console.status(f"step {before + 1}"):
            progress = tuner.step()
        if leads():
            saved.save(progress)
        if progress.iteration > before:
            _show(tuner, saved.seconds)
    console.print(tuner.progress.verdict)
    return tuner.progress, saved.seconds


def _show(tuner: Tuner, seconds: float) -> None:
    """A line; `by` is what the step used, and `exact` counts the closed loops whose derivatives remember all that the
    problem lets them."""
    progress = tuner.progress
    exact = f"{progress.memories.count(0)} of {len(progress.memories)}"
    kind = ("costs" if progress.kinds[-1] else "derivatives") if progress.kinds else ""
    console.print(
        f"{progress.iteration:6d} {kind:>11} {progress.cost:12.6g} {1e6 * np.max(tuner.cases.rms):10.4g} "
        f"{progress.trials:7d} {exact:>9} {seconds:8.1f}"
    )


def _verdict(summary: dict) -> None:
    if summary["failed"]:
        raise SimulationError(
            f"with the tuned gains {len(summary['failed'])} closed loops fail, the first of them "
            f"'{summary['failed'][0]}'; raise worst under [control.cost], or tune on more plants. {summary['failure']}"
        )
    if not summary["converged"]:
        raise SimulationError(f"tuning ended early: {summary['verdict']}")
