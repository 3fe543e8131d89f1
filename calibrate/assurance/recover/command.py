"""The command `recover`: a fitted model simulates the study's campaigns with new noise, and all are fitted again."""

import dataclasses
import functools
import pathlib
from collections.abc import Sequence
from typing import Any

import rich.progress

from vgtjax import SimulationError, Trace
from vgtjax.assurance import Recovery, Refit, Truth, refitting
from vgtjax.estimation import Task, run_alone, run_together

from ...fit.plan import plan
from ...output.console import console
from ...output.files import REPORT, SUMMARY, finite, write_json, write_text
from ...resumable import Folders, ProgressFile, run_units
from ...study.units import Job, Unit, prepare
from .report import render, render_overview

SEED = 2012


@dataclasses.dataclass(frozen=True)
class Done:
    """How many campaigns are done, and what came of them."""

    iteration: int = 0
    refits: tuple[Refit, ...] = ()

    def __post_init__(self) -> None:
        # A file has the fields of each by name.
        refits = tuple(each if isinstance(each, Refit) else Refit(**each) for each in self.refits)
        object.__setattr__(self, "refits", refits)

    def __add__(self, refit: Refit) -> "Done":
        return Done(self.iteration + 1, (*self.refits, refit))

    @property
    def found(self) -> list[Refit]:
        """The campaigns by number."""
        return sorted(self.refits, key=lambda refit: refit.number)


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path, campaigns: int) -> None:
    """Writes `summary.json` and `report.html`; with units, a folder each and the whole on top.

    Campaigns that an earlier run has finished are kept.

    **Raises:** `SimulationError` when no campaign of a unit could be fitted.
    """
    job = prepare(study, parameters, to_fit=True)
    job = dataclasses.replace(job, fingerprint=f"{job.fingerprint}-{campaigns}")
    for unit in job.units:
        plan(job, unit)
    compute = functools.partial(_recover_units, job, campaigns)
    summaries = run_units(job, out, "recover", compute, functools.partial(render_overview, job))
    bad = [f"{name or 'this study'}: {each['error']}" for name, each in summaries.items() if "error" in each]
    if bad:
        raise SimulationError("; ".join(bad))


def _recover_units(job: Job, campaigns: int, folders: Folders) -> None:
    for unit, folder in folders:
        task = plan(job, unit)
        try:
            applied = [_applied(unit, trace) for trace in task.fit]
            truth = run_alone(Truth.of(task, applied, _common_delay(unit, task.fit)))
        except SimulationError as error:
            write_json(folder / SUMMARY, {"error": str(error), **job.account(0.0)})
            continue
        _write(job, unit, folder, task, *_recover(unit, truth, campaigns, folder))


def _applied(unit: Unit, trace: Trace) -> Trace:
    duty = unit.duties.get(trace.name)
    return trace if duty is None else duty.applied(trace)


def _common_delay(unit: Unit, traces: Sequence[Trace]) -> float:
    """s by which the duty was found to be late beyond what its record says, in all traces; none where that differs, or
    where it was read otherwise as well, which a fit has to find beside it."""
    duties = [unit.duties.get(trace.name) for trace in traces]
    delays = {
        duty.delay - trace.duty_late if duty is not None and not (duty.edges or duty.linear) else 0.0
        for duty, trace in zip(duties, traces, strict=True)
    }
    return delays.pop() if len(delays) == 1 else 0.0


def _recover(unit: Unit, truth: Truth, campaigns: int, folder: pathlib.Path) -> tuple[list[Refit], float]:
    """All campaigns, those of an earlier run included, and the seconds that they took."""
    saved = ProgressFile(folder, Done, "the recovery")
    done = [Done() if saved.progress is None else saved.progress]
    left = set(range(campaigns)) - {refit.number for refit in done[0].found}
    who = "" if unit.name is None else f"{unit.name}: "
    with rich.progress.Progress(console=console, transient=True) as bar:
        count = bar.add_task(f"{who}campaigns", total=campaigns, completed=campaigns - len(left))

        def note(number: int, outcome: Refit | SimulationError) -> None:
            refit = Refit(number, False, str(outcome)) if isinstance(outcome, SimulationError) else outcome
            done[0] = done[0] + refit
            saved.save(done[0])
            bar.advance(count)

        run_together({number: refitting(truth, number, SEED) for number in sorted(left)}, note)
    return done[0].found, saved.seconds


def _write(job: Job, unit: Unit, folder: pathlib.Path, task: Task, refits: list[Refit], seconds: float) -> None:
    recovery = Recovery.of(task, refits)
    who = "" if unit.name is None else f"{unit.name}: "
    if not len(recovery.estimates):
        write_json(folder / SUMMARY, {"error": f"no campaign: {recovery.failed[0]}", **job.account(seconds)})
        return
    for sentence in (*recovery.sentences, *recovery.failed):
        console.print(f"{who}{sentence}")
    write_json(folder / SUMMARY, {**summary(recovery, len(refits)), **job.account(seconds)})
    write_text(folder / REPORT, render(job, unit.name, recovery, len(refits), seconds))
    ProgressFile.remove_from(folder)


def summary(recovery: Recovery, campaigns: int) -> dict[str, Any]:
    """In the units of the parameter table; `None` for what no campaign determined."""

    def by_entry(values: Any) -> dict[str, Any]:
        return dict(zip(recovery.entries, finite(values), strict=True))

    return {
        "campaigns": campaigns,
        "failed": list(recovery.failed),
        "coverage_of_all": recovery.total,
        "coverage": by_entry(recovery.coverage),
        "bias": by_entry(recovery.bias),
        "spread": by_entry(recovery.spread),
        "claimed": by_entry(recovery.claimed),
        "determined": by_entry(recovery.known),
        "scores": by_entry(recovery.scores.T),  # of each campaign that converged: its error in standard errors
        "sentences": recovery.sentences,
    }
