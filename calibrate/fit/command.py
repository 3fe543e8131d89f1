"""The command `fit`: calibrates every unit of a study, resumably, and reports."""

import pathlib
from collections.abc import Sequence
from typing import Any

import jax

from vgtjax import SimulationError
from vgtjax.assurance import ending_certified, require_blackjax
from vgtjax.estimation import (
    Calibration,
    Computation,
    End,
    Progress,
    Question,
    foreseen,
    foreseen_certificate,
    found_besides,
    run_alone,
    run_together,
)
from vgtjax.identification import starting_fit

from ..output.console import console, say
from ..output.files import REPORT, SUMMARY, finite, read_json, write_json, write_text
from ..output.sections import sensor_summary, trace_summary
from ..resumable import Folders, ProgressFile, run_units
from ..study.models import passivity_note, taken_for_exact
from ..study.parameter_file import Entry, calibrated, covariance, nuisance, to_json
from ..study.places import OF_A_MODEL, stated
from ..study.units import Job, Unit, prepare
from ..workers import each_unit
from . import beforehand
from .around import summarise as summarise_around
from .budget import budget_rows
from .decisions import decisions
from .outcome import Fitted
from .plan import plan
from .posterior import sample, summary
from .report import render, render_overview
from .terminal import last_words, verdict

FEW = 3
"""Units that one process fits together on a CPU. More are shared out to processes, each with one fit after the other,
as Python works for one fit at a time between simulations: four units took 0.9 of the time on two cores."""


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `parameters.json`, `summary.json` and `report.html`; with units, a folder each and the whole on top.

    What was finished by an earlier run of the same study is kept; a fit that was interrupted goes on where it was.

    **Raises:** `SimulationError` when a unit failed or did not converge, after everything else is written.
    """
    job = prepare(study, parameters, to_fit=True)
    for unit in job.units:
        plan(job, unit)  # mistakes of any unit are found before the first one is fitted
    if job.study.fit.posterior:
        with stated(OF_A_MODEL):
            require_blackjax()
    summaries = run_units(
        job,
        out,
        "fit",
        lambda folders: _fit_units(job, folders),
        lambda summaries: render_overview(job, summaries, _population(job, out)),
    )
    bad = {name: summary for name, summary in summaries.items() if "error" in summary or not summary["converged"]}
    if bad:
        reasons = [f"{name or 'the fit'}: {entry.get('error') or entry['verdict']}" for name, entry in bad.items()]
        raise SimulationError("; ".join(reasons))


def _fit_units(job: Job, folders: Folders) -> None:
    """Fits the units that are left, side by side if the study has several, and writes the files of each as it ends."""
    if len(job.units) > 1:
        for sentence in dict.fromkeys(each for unit, _ in folders for each in taken_for_exact(plan(job, unit))):
            console.print(f"note: {sentence}")
    if len(job.units) == 1 or (len(job.units) > FEW and jax.default_backend() == "cpu"):
        each_unit(job, folders, _fit_unit)
    elif folders:
        _fit_together(job, folders)


def _fit_unit(job: Job, unit: Unit, folder: pathlib.Path) -> None:
    _write(job, unit, folder, _outcome_alone(_fitting(job, unit, folder), _ahead(job, unit)))


def _fit_together(job: Job, folders: Folders) -> None:
    """Fits as lanes of one program, in one process."""
    names = {unit.name: (unit, folder) for unit, folder in folders}
    fits = {name: _fitting(job, *place) for name, place in names.items()}
    with console.status(f"{len(fits)} fits side by side"):
        run_together(fits, lambda name, outcome: _write(job, *names[name], outcome), _ahead(job, folders[0][0]))


def _ahead(job: Job, unit: Unit) -> list[Question]:
    """What the fit of a unit asks beside its start."""
    task = plan(job, unit)
    return [*foreseen(task), foreseen_certificate(task)]


def _outcome_alone(fit: Computation[Fitted], ahead: Sequence[Question]) -> Fitted | SimulationError:
    try:
        return run_alone(fit, ahead)
    except SimulationError as error:
        return error


def _fitting(job: Job, unit: Unit, folder: pathlib.Path) -> Computation[Fitted]:
    """The fit of one unit, which keeps its progress on disk and says what it does."""
    who = "" if unit.name is None else f"{unit.name}: "
    saved = ProgressFile(folder, Progress, f"{who}the fit")
    calibrator = yield from starting_fit(plan(job, unit), saved.progress)
    for note in calibrator.notes:
        console.print(f"note: {who}{note}")
    known = saved.facts or (yield from beforehand.knowing(calibrator))
    beforehand.say(known, who)

    def show(progress: Progress) -> None:
        kind = "  corrected" if progress.corrections else ""
        console.print(
            f"{who}{progress.iteration:6d} {2 * progress.cost:12.6g} {1 / progress.step_size:10.3g} "
            f"{saved.seconds:8.1f}{kind}"
        )

    def report(progress: Progress) -> None:
        saved.save(progress, **known)
        show(progress)

    console.print(f"{who}{'step':>6} {'chi^2/N':>12} {'damping':>10} {'seconds':>8}")
    show(calibrator.minimiser.progress)
    calibrator, found = yield from ending_certified(calibrator, report, job.study.fit.profiles)
    calibration, certificate, around, posterior = found.calibration, found.certificate, found.around, None
    if found.usable and job.study.fit.posterior:
        posterior = sample(End.of(calibrator), job.study.fit.posterior, folder, who)
        console.print(f"{who}found: posterior: {posterior.verdict}")
    exact = taken_for_exact(calibration.task) if unit.name is None else []  # of all units it is said once
    besides = (*found_besides(calibration), *exact, *certificate.remarks)
    for sentence in (*besides, *(() if around is None else around.sentences)):
        console.print(f"{who}found: {sentence}")
    return Fitted(calibration, certificate, around, posterior, saved.seconds, known)


def _write(job: Job, unit: Unit, folder: pathlib.Path, outcome: Fitted | SimulationError) -> None:
    """The files of one unit, the report last; what can't be simulated leaves a summary that says so."""
    if isinstance(outcome, SimulationError):
        failure = {"converged": False, "error": str(outcome), "iterations": 0, "traces": {}}
        write_json(folder / SUMMARY, {**failure, **job.account(0.0)})
        return
    calibration, around = outcome.calibration, outcome.around
    table = calibrated(calibration, around, usable=outcome.usable)
    note = passivity_note(calibration.model)
    if note is not None:
        console.print(f"warning: {'' if unit.name is None else f'{unit.name}: '}{note}")
    write_json(
        folder / "parameters.json",
        to_json(job.study, table, nuisance=nuisance(calibration), covariance=covariance(calibration)),
    )
    write_json(folder / SUMMARY, _summary(outcome, job, unit, table))
    page = render(job, unit, outcome, table)
    write_text(folder / REPORT, page)
    ProgressFile.remove_from(folder)
    who = "" if unit.name is None else f"{unit.name}: "
    for part in last_words(outcome, table) if unit.name is None else [f"{who}verdict: {verdict(outcome, table)}"]:
        say(part)


def _population(job: Job, out: pathlib.Path) -> dict[str, dict[str, Any]]:
    """Content of `parameters.json` by unit, of those that have one."""
    files = {unit.name: unit.folder(out) / "parameters.json" for unit in job.units}
    return {name: read_json(file)["parameters"] for name, file in files.items() if name and file.exists()}


def _summary(fitted: Fitted, job: Job, unit: Unit, table: Sequence[Entry]) -> dict[str, Any]:
    calibration = fitted.calibration
    return {
        **_of_the_search(calibration),
        **_of_the_bench(calibration),
        "unidentifiable_at_start": fitted.not_estimable,
        "expected_relative_error_at_start": fitted.known_before["expected_relative_error"],
        "check": {name: fitted.known_before[name] for name in ("null", "nearly_null", "next", "sentences")},
        "friction_is_passive": passivity_note(calibration.model) is None,
        "sentence": verdict(fitted, table),
        "found": [
            *found_besides(calibration),
            *taken_for_exact(calibration.task),
            *filter(None, [passivity_note(calibration.model)]),
        ],
        "noise_by_windows": {"seconds": calibration.budget.window, "factor": finite(calibration.budget.excess)},
        "budget": {row.name: row.summary() for row in budget_rows(calibration)},
        "decisions": [each.summary() for each in decisions(fitted, table)],
        "report": job.study.report.model_dump(exclude_none=True),
        **job.account(fitted.seconds),
        **({} if fitted.around is None else summarise_around(fitted.around)),
        **({} if fitted.posterior is None else {"posterior": summary(fitted.posterior, calibration)}),
        "traces": _of_traces(calibration, unit),
        "certificate": {
            **fitted.certificate.summary(),
            "sentence": fitted.certificate.sentence,
            "traces": {each.trace.name: "failed" if each.failed else "simulated" for each in calibration.traces},
            "rejected_steps": calibration.progress.rejected,
            "failed_simulations": calibration.progress.failed,
        },
        **({"error": "; ".join(fitted.troubles)} if fitted.troubles else {}),
    }


def _of_the_search(calibration: Calibration) -> dict[str, Any]:
    progress = calibration.progress
    return {
        "converged": calibration.converged,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "rejected_steps": progress.rejected,
        "failed_simulations": progress.failed,
        "cost": progress.cost,
        "cost_at_start": progress.history[0],
        "measurements": calibration.count,
        "chi2_per_degree_of_freedom": calibration.uncertainty.scale,
        "chi2_gain_of_a_further_linear_step": calibration.uncertainty.gain,
        "corrections": {
            "count": progress.corrections,
            "settled": progress.settled,
            "moved": dict(zip(calibration, finite(calibration.shifts), strict=True)),
        },
        "starts": [{"start": number, **ended._asdict()} for number, ended in enumerate(progress.ends)],
    }


def _of_the_bench(calibration: Calibration) -> dict[str, Any]:
    return {
        "duty_hold": {result.trace.name: calibration.duty_hold(result.trace) for result in calibration.traces},
        "duty_hold_decided": calibration.progress.hold_decided,
        "duty_delay": calibration.duty_delay,
        "duty_delay_std_error": calibration.duty_delay_error,
        "instruments": {
            entry: {"value": value, "std_error": finite(error)}
            for entry, (value, error) in calibration.instruments.items()
        },
    }


def _of_traces(calibration: Calibration, unit: Unit) -> dict[str, Any]:
    learned = zip(calibration.task.fit, calibration.sensors, strict=True)
    sensors = {trace.name: {"sensors": sensor_summary(known)} for trace, known in learned}
    return {
        result.trace.name: {
            **trace_summary(result),
            **sensors.get(result.trace.name, {}),
            "sha256": unit.hashes[result.trace.name],
        }
        for result in calibration.traces
    }
