"""The command `compare`: fits the alternatives of every component, resumably, and ranks them."""

import contextlib
import functools
import pathlib
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence

from vgtjax import Calibration, InputError, SimulationError
from vgtjax.estimation import (
    Computation,
    Progress,
    Question,
    asked_first,
    compiling_ahead,
    foreseen,
    run_alone,
    run_together,
)
from vgtjax.identification import (
    Ahead,
    Begin,
    Compared,
    Structure,
    comparing_structures,
    nothing_ahead,
    starting_fit,
)

from ..output.console import console
from ..output.files import REPORT, SUMMARY, write_json, write_text
from ..resumable import Folders, ProgressFile, run_units
from ..study.units import Job, Unit, prepare
from .alternatives import ALIKE, WIDER, options, own_structure, plan
from .report import render, render_overview
from .verdict import Verdict, judge

FITS = ".fits"


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `summary.json` and `report.html`; with units, a folder each and the whole on top.

    Fits that an earlier run of the same study has finished are kept; one that was interrupted goes on where it was.

    **Raises:** `SimulationError` when no fit of a unit may be used, after everything else is written.
    """
    job = prepare(study, parameters, to_fit=True)
    for unit in job.units:
        plan(job, unit, own_structure(job.study), {})  # mistakes of any unit are found before the first one is fitted
    compute, overview = functools.partial(_compare_units, job), functools.partial(render_overview, job)
    summaries = run_units(job, out, "compare", compute, overview)
    bad = [f"{name or 'this study'}: {summary['error']}" for name, summary in summaries.items() if "error" in summary]
    if bad:
        raise SimulationError("; ".join(bad))


def _compare_units(job: Job, folders: Folders) -> None:
    """Compares for the units that are left, side by side if there are several."""
    names = {unit.name: (unit, folder) for unit, folder in folders}
    if len(names) == 1:
        for unit, folder in names.values():
            _write(job, unit, folder, run_alone(_comparing(job, unit, folder, functools.partial(_ahead, job, unit))))
        return
    searches = {name: _comparing(job, *place) for name, place in names.items()}
    with console.status(f"{len(searches)} units side by side"):
        run_together(searches, lambda name, outcome: _write(job, *names[name], outcome))


Outcome = tuple[Compared, float]
"""What was found, and the seconds that it took."""


def _comparing(job: Job, unit: Unit, folder: pathlib.Path, ahead: Ahead = nothing_ahead) -> Computation[Outcome]:
    began, own = time.monotonic(), own_structure(job.study)

    def fitting(structure: Mapping[str, str], begin: Begin) -> Computation[Calibration]:
        return _fitting(job, unit, folder, structure, begin)

    compared = yield from comparing_structures(own, options(job.study, unit), fitting, WIDER, ALIKE, ahead)
    return compared, time.monotonic() - began


def _ahead(job: Job, unit: Unit, structures: Sequence[Structure]) -> contextlib.AbstractContextManager[None]:
    """Compiles beside the fits what each asks first and soon."""

    def questions() -> Iterator[Question]:
        for structure in structures:
            with contextlib.suppress(InputError, SimulationError):  # its fit says so
                task = plan(job, unit, structure, {})
                yield from (asked_first(task), *foreseen(task))

    return compiling_ahead(questions())


def _fitting(
    job: Job, unit: Unit, folder: pathlib.Path, structure: Mapping[str, str], begin: Begin
) -> Computation[Calibration]:
    """The fit of one structure, which keeps its progress on disk."""
    name = "+".join((*structure.values(), *(["again"] if begin.again else [])))
    who = name if unit.name is None else f"{unit.name}: {name}"
    # A structure that can't be simulated from another one's values begins again from its own, with its own progress.
    place = folder / FITS / (name if begin.values else f"{name}+own")
    place.mkdir(parents=True, exist_ok=True)
    try:
        task = begin.of(plan(job, unit, structure, begin.values))
    except InputError as error:
        raise SimulationError(f"it has no start: {error}") from error
    saved = ProgressFile(place, Progress, f"the fit of {who}")
    try:
        calibrator = yield from starting_fit(task, saved.progress)
        calibration = yield from calibrator.steps(saved.save)
    except SimulationError as error:
        console.print(f"{who}: {error}")
        raise
    chi2, steps = 2 * calibration.progress.cost, calibration.progress.iteration
    console.print(f"{who}: chi^2/N {chi2:.6g} after {steps} steps, {calibration.verdict} ({saved.seconds:.1f} s)")
    return calibration


def _write(job: Job, unit: Unit, folder: pathlib.Path, outcome: Outcome | SimulationError) -> None:
    """The files of one unit, the report last."""
    if isinstance(outcome, SimulationError):
        write_json(folder / SUMMARY, {"error": str(outcome), **job.account(0.0)})
        return
    compared, seconds = outcome
    if compared.fit is None:
        reasons = {row.name: row.reason for ranking in compared.rankings.values() for row in ranking.rows}
        sentence = "no fit may be used: " + "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
        write_json(folder / SUMMARY, {"error": sentence, **job.account(seconds)})
        return
    verdict = judge(job.study, unit, compared)
    _say(unit, verdict)
    write_json(folder / SUMMARY, {**verdict.summary(), **job.account(seconds)})
    write_text(folder / REPORT, render(job, unit.name, compared, verdict, seconds))
    shutil.rmtree(folder / FITS, ignore_errors=True)


def _say(unit: Unit, verdict: Verdict) -> None:
    who = "" if unit.name is None else f"{unit.name}: "
    for name, choice in verdict.choices.items():
        console.print(f"{who}{name}: {choice.value}, {'decided' if choice.decided else 'not decided'}: {choice.reason}")
