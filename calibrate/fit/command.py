"""The command `fit`: calibrates every unit of a study, resumably, and reports."""

import dataclasses
import math
import pathlib
import time
from typing import Any

import numpy as np

import vgtjax
from vgtjax import InputError, SimulationError
from vgtjax.estimation import RUNAWAY, Calibration, Progress, TraceResult, plan_task, start_calibration
from vgtjax.identification import better_start, moves_at_start
from vgtjax.parameters import build_transform, table_row

from ..output.console import FitDisplay, console, say_notes
from ..output.files import PROGRESS, claim, read_json, write_json, write_text
from ..output.hysteresis import loop_widths
from ..study.models import passivity_note
from ..study.parameter_file import rows, to_json
from ..study.units import Job, Unit, check_fit, prepare
from .report import UnitReport, render, render_overview


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `parameters.json`, `summary.json` and `report.html`; with units, a folder each and the whole on top.

    What was finished by an earlier run of the same study is kept; a fit that was interrupted goes on where it was.

    **Raises:** `InputError` before anything is written; `SimulationError` when a unit failed or did not converge,
    after everything else is written.
    """
    job = prepare(study, parameters, needs=("x_d|p_act",))
    check_fit(job)
    tasks = [_plan(job, unit) for unit in job.units]
    claim(out, "fit", job.fingerprint)
    if (out / "report.html").exists():
        console.print(f"nothing to do: {out} holds this study's results")
        console.print(f"report: {(out / 'report.html').resolve()}")
        _verdict({unit.name: read_json(unit.folder(out) / "summary.json") for unit in job.units})
        return
    summaries: dict[str | None, dict[str, Any]] = {}
    for unit, task in zip(job.units, tasks, strict=True):
        folder = unit.folder(out)
        folder.mkdir(exist_ok=True)
        if (folder / "report.html").exists():
            console.print(f"{unit.name}: {folder} holds its results")
        else:
            _fit_unit(job, unit, task, folder)
        summaries[unit.name] = read_json(folder / "summary.json")
    if job.units[0].name is not None:
        write_json(out / "summary.json", {"units": summaries})
        write_text(out / "report.html", render_overview(job, summaries, _population(job, out)))
    if (out / "report.html").exists():
        console.print(f"report: {(out / 'report.html').resolve()}")
    _verdict(summaries)


def _fit_unit(job: Job, unit: Unit, task: vgtjax.estimation.Task, folder: pathlib.Path) -> None:
    """Fits one unit and writes its files, the report last; what can't be simulated leaves a summary that says so."""
    say_notes(trace for _, trace in unit.traces)
    began = time.monotonic()
    try:
        calibration, seconds, unseen = _fit(unit, task, folder)
    except SimulationError as error:
        write_json(folder / "summary.json", _failure(error, time.monotonic() - began, job))
        return
    note = passivity_note(calibration.model)
    if note is not None:
        console.print(f"warning: {note}")
    found = rows(calibration)
    write_json(folder / "parameters.json", to_json(job.study, found))
    write_json(folder / "summary.json", _summary(calibration, seconds, unseen, job))
    write_text(folder / "report.html", render(job, UnitReport(unit.name, calibration, found, seconds, unseen)))
    (folder / PROGRESS).unlink(missing_ok=True)


def _population(job: Job, out: pathlib.Path) -> dict[str, dict[str, Any]]:
    """Content of `parameters.json` by unit, of those that have one."""
    files = {unit.name: unit.folder(out) / "parameters.json" for unit in job.units}
    return {name: read_json(file)["parameters"] for name, file in files.items() if name and file.exists()}


def _plan(job: Job, unit: Unit) -> vgtjax.estimation.Task:
    channels = ("x_d",) if job.study.model == "mechanical" else vgtjax.estimation.CHANNELS
    task = plan_task(
        unit.model,
        unit.used("fit"),
        unit.used("validate"),
        free=job.study.fit.free,
        fixed=job.study.fit.fixed,
        bounds=unit.bounds,
        channels=channels,
    )
    if not task.selection.entries:
        raise InputError("a fit needs at least one free parameter, but free and fixed leave none; free one")
    # Here, before anything is written: a start value outside its bounds is bad input.
    start = np.asarray(task.selection.pack(task.model))
    build_transform(vgtjax.parameter_table(task.model), task.selection.entries, start, task.bounds)
    return task


def _fit(unit: Unit, task: vgtjax.estimation.Task, folder: pathlib.Path) -> tuple[Calibration, float, list[str]]:
    """Fits one unit, keeping its progress on disk; also the seconds it took, and what it could not see."""
    saved = folder / PROGRESS
    earlier, resume, unseen = _load_progress(saved)
    began = time.monotonic() - earlier
    with FitDisplay(unit.name or "fit") as display:
        calibrator = start_calibration(task, _first(task) if resume is None else resume)
        if resume is None:
            unseen = calibrator.unidentifiable()
        if unseen:
            console.print(f"warning: these traces do not determine {', '.join(unseen)}; hold or excite them")
        progress = calibrator.minimiser.progress
        if resume is not None:
            console.print(f"resuming after step {progress.iteration}")
        display.show(progress)
        while not progress.finished:
            progress = calibrator.minimiser.step()
            seconds = time.monotonic() - began
            write_json(saved, {"seconds": seconds, "unseen": unseen, "progress": dataclasses.asdict(progress)})
            display.show(progress)
        display.wait("simulating all traces")
        calibration = calibrator.finish()
        display.wait("writing the report")
        return calibration, time.monotonic() - began, unseen


def _first(task: vgtjax.estimation.Task) -> Progress | None:
    """Where a fit of an axis that a force drives begins, if not at its start values."""
    for trace in task.fit:
        moving = moves_at_start(trace)
        if moving is not None:
            console.print(
                f"note: {trace.name}: it begins at {moving[0]:.2g} m/s, but a simulation begins at rest; "
                f"window = [{moving[1]:.3f}, {trace.time[-1]:.3f}] leaves that out"
            )
    begin = better_start(task)
    if begin is not None:
        console.print("note: the search begins at what a regression of force and position tells")
    return begin


def _load_progress(saved: pathlib.Path) -> tuple[float, Progress | None, list[str]]:
    """Seconds already spent, where the fit was, and what its start could not see; nothing where nothing is saved."""
    if not saved.exists():
        return 0.0, None, []
    try:
        content = read_json(saved)
        progress = content["progress"]
        lists = {"coordinates": tuple(progress["coordinates"]), "history": tuple(progress["history"])}
        return float(content["seconds"]), Progress(**{**progress, **lists}), list(content["unseen"])
    except (InputError, KeyError, TypeError, ValueError):
        console.print(f"note: {saved} can't be read, so the fit begins anew")
        return 0.0, None, []


def _failure(error: SimulationError, seconds: float, job: Job) -> dict[str, Any]:
    return {
        "converged": False,
        "error": str(error),
        "iterations": 0,
        "wall_seconds": round(seconds, 3),
        "study_sha256": job.fingerprint,
        "traces": {},
    }


def _summary(calibration: Calibration, seconds: float, unseen: list[str], job: Job) -> dict[str, Any]:
    progress = calibration.progress
    traces = {result.trace.name: trace_summary(result) for result in calibration.traces}
    failed = [name for name, entry in traces.items() if None in entry["rmse"].values()]
    troubles = (
        [f"the simulation of {', '.join(failed)} with the fitted values left the finite numbers"] if failed else []
    )
    if calibration.ran_away:
        troubles.append(_runaway(calibration))
    return {
        "converged": progress.converged and not calibration.ran_away,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "rejected_steps": progress.iteration - progress.accepted,
        "failed_simulations": progress.failed,
        "wall_seconds": round(seconds, 3),
        "cost": progress.cost,
        "chi2_per_degree_of_freedom": calibration.uncertainty.scale,
        "chi2_gain_of_a_further_linear_step": calibration.uncertainty.gain,
        "unidentifiable_at_start": unseen,
        "friction_is_passive": passivity_note(calibration.model) is None,
        "study_sha256": job.fingerprint,
        "traces": traces,
        **({"error": "; ".join(troubles)} if troubles else {}),
    }


def _runaway(calibration: Calibration) -> str:
    """What is wrong with a fit that ran away, and its remedy."""
    table, entries = vgtjax.parameter_table(calibration.model), calibration.task.selection.entries
    start = np.asarray(calibration.task.selection.pack(calibration.task.model))
    ends = [
        f"{entry} ended at {value:.4g} {table_row(table, entry).unit} (start {begin:.4g})"
        for entry, value, begin in zip(entries, calibration.values, start, strict=True)
        if entry in calibration.ran_away
    ]
    return (
        f"fitted values must stay within a factor {RUNAWAY:g} of their start values, but {', '.join(ends)}; give "
        "bounds or better start values under [parameters]"
    )


def trace_summary(result: TraceResult) -> dict[str, Any]:
    """How a model meets one trace, in SI units, as summaries state it."""

    def finite(values: dict[str, float]) -> dict[str, float | None]:
        return {channel: value if math.isfinite(value) else None for channel, value in values.items()}

    widths = loop_widths(result)
    return {
        "use": result.use,
        "rmse": finite(result.rmse),
        "offset": finite(result.offset),
        "noise": {name: channel.noise for name, channel in result.channels.items()},
        **({} if widths is None else {"loop_width": widths}),
        "notes": list(result.trace.notes),
    }


def _verdict(summaries: dict[str | None, dict[str, Any]]) -> None:
    bad = {name: entry for name, entry in summaries.items() if "error" in entry or not entry["converged"]}
    if bad:
        reasons = [
            f"{'the fit' if name is None else name}: {entry.get('error', entry.get('verdict'))}"
            for name, entry in bad.items()
        ]
        raise SimulationError("; ".join(reasons))
