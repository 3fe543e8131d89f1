"""The command `fit`: calibrates every unit of a study, resumably, and reports."""

import pathlib
import time
from typing import Any

from vgtjax import Calibration, SimulationError
from vgtjax.estimation import Progress, Task, Unknown
from vgtjax.identification import plan_fit, start_fit

from ..output.console import console
from ..output.files import REPORT, SUMMARY, finite, read_json, write_json, write_text
from ..output.sections import sensor_summary, trace_summary
from ..resumable import ProgressFile, run_units
from ..study.models import passivity_note
from ..study.parameter_file import calibrated, covariance, nuisance, to_json
from ..study.units import Job, Unit, prepare
from .report import found_besides, render, render_overview


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `parameters.json`, `summary.json` and `report.html`; with units, a folder each and the whole on top.

    What was finished by an earlier run of the same study is kept; a fit that was interrupted goes on where it was.

    **Raises:** `SimulationError` when a unit failed or did not converge, after everything else is written.
    """
    job = prepare(study, parameters, to_fit=True)
    tasks = {unit.name: _plan(job, unit) for unit in job.units}
    summaries = run_units(
        job,
        out,
        "fit",
        lambda unit, folder: _fit_unit(job, unit, tasks[unit.name], folder),
        lambda summaries: render_overview(job, summaries, _population(job, out)),
    )
    bad = {name: summary for name, summary in summaries.items() if not summary["converged"]}
    if bad:
        reasons = [f"{name or 'the fit'}: {entry.get('error') or entry['verdict']}" for name, entry in bad.items()]
        raise SimulationError("; ".join(reasons))


def _plan(job: Job, unit: Unit) -> Task:
    chosen = job.study.fit
    table = chosen.unknown.model_copy(update={"duty_delay": False} if unit.knows_delay else {})
    unknown = Unknown(loss=chosen.loss, **dict(table))
    wanted = {"free": chosen.free, "fixed": chosen.fixed, "bounds": unit.bounds, "unknown": unknown}
    return plan_fit(unit.model, unit.used("fit"), unit.used("validate"), **wanted)


def _fit_unit(job: Job, unit: Unit, task: Task, folder: pathlib.Path) -> None:
    """Fits one unit and writes its files, the report last; what can't be simulated leaves a summary that says so."""
    began = time.monotonic()
    try:
        calibration, seconds, undetermined = _fit(unit, task, folder)
    except SimulationError as error:
        failure = {"converged": False, "error": str(error), "iterations": 0, "traces": {}}
        write_json(folder / SUMMARY, {**failure, **job.account(time.monotonic() - began)})
        return
    note = passivity_note(calibration.model)
    if note is not None:
        console.print(f"warning: {note}")
    table = calibrated(calibration)
    write_json(
        folder / "parameters.json",
        to_json(job.study, table, nuisance=nuisance(calibration), covariance=covariance(calibration)),
    )
    write_json(folder / SUMMARY, _summary(calibration, seconds, undetermined, job))
    write_text(folder / REPORT, render(job, unit.name, calibration, table, seconds, undetermined))
    ProgressFile.remove_from(folder)


def _fit(unit: Unit, task: Task, folder: pathlib.Path) -> tuple[Calibration, float, list[str]]:
    """Fits one unit, keeping its progress on disk; also the seconds it took, and what it could not see."""
    saved, title = ProgressFile(folder, Progress, "the fit"), unit.name or "fit"
    with console.status(f"{title}: compiling") as status:
        calibrator = start_fit(task, saved.progress)
        resumed = saved.progress is not None
        undetermined = list(saved.facts.get("undetermined", ())) if resumed else calibrator.undetermined()
        for note in calibrator.notes:
            console.print(f"note: {note}")
        if undetermined:
            console.print(f"warning: these traces do not determine {', '.join(undetermined)}; hold or excite them")

        def show(progress: Progress) -> None:
            kind = "  rejected" if progress.rejected_in_a_row else "  corrected" if progress.corrections else ""
            console.print(
                f"{progress.iteration:6d} {2 * progress.cost:12.6g} {1 / progress.step_size:10.3g} "
                f"{saved.seconds:8.1f}{kind}"
            )
            status.update(f"{title}: step {progress.iteration + 1}")

        def report(progress: Progress) -> None:
            saved.save(progress, undetermined=undetermined)
            show(progress)

        console.print(f"{'step':>6} {'chi^2/N':>12} {'damping':>10} {'seconds':>8}")
        show(calibrator.minimiser.progress)
        calibration = calibrator.run(report)
        for sentence in found_besides(calibration):
            console.print(f"found: {sentence}")
        status.update(f"{title}: writing the report")
        return calibration, saved.seconds, undetermined


def _population(job: Job, out: pathlib.Path) -> dict[str, dict[str, Any]]:
    """Content of `parameters.json` by unit, of those that have one."""
    files = {unit.name: unit.folder(out) / "parameters.json" for unit in job.units}
    return {name: read_json(file)["parameters"] for name, file in files.items() if name and file.exists()}


def _summary(calibration: Calibration, seconds: float, undetermined: list[str], job: Job) -> dict[str, Any]:
    progress = calibration.progress
    learned = zip(calibration.task.fit, calibration.sensors, strict=True)
    sensors = {trace.name: {"sensors": sensor_summary(known)} for trace, known in learned}
    return {
        "converged": calibration.converged,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "rejected_steps": progress.iteration - progress.accepted,
        "failed_simulations": progress.failed,
        "cost": progress.cost,
        "chi2_per_degree_of_freedom": calibration.uncertainty.scale,
        "chi2_gain_of_a_further_linear_step": calibration.uncertainty.gain,
        "corrections": {
            "count": progress.corrections,
            "settled": progress.settled,
            "moved": dict(zip(calibration.task.selection.entries, finite(calibration.shifts), strict=True)),
        },
        "duty_delay": calibration.duty_delay,
        "duty_delay_std_error": calibration.duty_delay_error,
        "unidentifiable_at_start": undetermined,
        "friction_is_passive": passivity_note(calibration.model) is None,
        **job.account(seconds),
        "traces": {
            result.trace.name: {**trace_summary(result), **sensors.get(result.trace.name, {})}
            for result in calibration.traces
        },
        **({"error": calibration.verdict} if calibration.troubles else {}),
    }
