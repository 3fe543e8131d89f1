"""The command `fit`: calibrates every unit of a study, resumably, and reports."""

import dataclasses
import pathlib
import time
from typing import Any

import vgtjax
from vgtjax.errors import SimulationError
from vgtjax.estimation import Calibration, Progress, plan_task, start_calibration

from .console import FitDisplay, console
from .files import PROGRESS, claim, read_json, write_json, write_text
from .job import Job, Unit, check_fit, prepare
from .parameter_file import rows, to_json
from .report import UnitReport, render


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `parameters.json`, `summary.json` and `report.html`; with units, a folder each and the whole on top.

    What was finished by an earlier run of the same study is kept; a fit that was interrupted goes on where it was.

    **Raises:** `InputError` before anything is written; `SimulationError` when a unit failed or did not converge,
    after everything else is written.
    """
    job = prepare(study, parameters)
    check_fit(job)
    tasks = [_plan(job, unit) for unit in job.units]
    claim(out, "fit", job.fingerprint)
    if (out / "report.html").exists():
        console.print(f"nothing to do: {out} holds this study's results")
        console.print(f"report: {(out / 'report.html').resolve()}")
        _verdict({unit.name: read_json(unit.folder(out) / "summary.json") for unit in job.units})
        return
    summaries: dict[str | None, dict[str, Any]] = {}
    reports: list[UnitReport] = []
    for unit, task in zip(job.units, tasks, strict=True):
        folder = unit.folder(out)
        folder.mkdir(exist_ok=True)
        _say_notes(unit)
        try:
            calibration, seconds, unseen = _fit(unit, task, folder)
        except SimulationError as error:
            summaries[unit.name] = {"converged": False, "error": str(error), "traces": {}}
            write_json(folder / "summary.json", summaries[unit.name])
            continue
        found = rows(calibration)
        summaries[unit.name] = _summary(calibration, seconds, unseen, job)
        write_json(folder / "parameters.json", to_json(job.study, found))
        write_json(folder / "summary.json", summaries[unit.name])
        report = UnitReport(unit.name, calibration, found, seconds, unseen)
        if unit.name is not None:
            write_text(folder / "report.html", render(job, [report]))
        (folder / PROGRESS).unlink(missing_ok=True)
        reports.append(report)
    if job.units[0].name is not None:
        write_json(out / "summary.json", {"units": summaries})
    if reports:
        write_text(out / "report.html", render(job, reports))
        console.print(f"report: {(out / 'report.html').resolve()}")
    _verdict(summaries)


def _plan(job: Job, unit: Unit) -> vgtjax.estimation.Task:
    channels = ("x_d",) if job.study.model == "mechanical" else vgtjax.estimation.CHANNELS
    return plan_task(
        unit.model,
        unit.used("fit"),
        unit.used("validate"),
        free=job.study.fit.free,
        fixed=job.study.fit.fixed,
        bounds=unit.bounds,
        channels=channels,
    )


def _say_notes(unit: Unit) -> None:
    for _, trace in unit.traces:
        for note in trace.notes:
            console.print(f"note: {trace.name}: {note}")


def _fit(
    unit: Unit, task: vgtjax.estimation.Task, folder: pathlib.Path
) -> tuple[Calibration, float, list[str]]:
    """Fits one unit, keeping its progress on disk; also the seconds it took and what the start could not see."""
    saved = folder / PROGRESS
    earlier = read_json(saved) if saved.exists() else {"seconds": 0.0, "progress": None}
    began = time.monotonic() - earlier["seconds"]
    resume = None if earlier["progress"] is None else _to_progress(earlier["progress"])
    with FitDisplay(unit.name or "fit") as display:
        calibrator = start_calibration(task, resume)
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
            write_json(saved, {"seconds": seconds, "progress": dataclasses.asdict(progress)})
            display.show(progress)
        display.wait("simulating all traces")
        calibration = calibrator.finish()
        display.wait("writing the report")
        return calibration, time.monotonic() - began, unseen


def _to_progress(saved: dict[str, Any]) -> Progress:
    return Progress(**{**saved, "coordinates": tuple(saved["coordinates"]), "history": tuple(saved["history"])})


def _summary(calibration: Calibration, seconds: float, unseen: list[str], job: Job) -> dict[str, Any]:
    progress = calibration.progress
    return {
        "converged": progress.converged,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "rejected_steps": progress.iteration - progress.accepted,
        "failed_simulations": progress.failed,
        "wall_seconds": round(seconds, 3),
        "cost": progress.cost,
        "chi2_per_degree_of_freedom": calibration.uncertainty.scale,
        "unidentifiable_at_start": unseen,
        "study_sha256": job.fingerprint,
        "traces": {
            result.trace.name: {
                "use": result.use,
                "rmse": result.rmse,
                "offset": result.offset,
                "noise": result.noise,
            }
            for result in calibration.traces
        },
    }


def _verdict(summaries: dict[str | None, dict[str, Any]]) -> None:
    bad = {name: entry for name, entry in summaries.items() if not entry["converged"]}
    if bad:
        reasons = [
            f"{'the fit' if name is None else name}: {entry.get('error', entry.get('verdict'))}"
            for name, entry in bad.items()
        ]
        raise SimulationError("; ".join(reasons))
