"""The command `check`: what can be known from the traces of a study, and which run to record next."""

import dataclasses
import functools
import pathlib
import time
from collections.abc import Sequence
from typing import Any

from vgtjax import SimulationError
from vgtjax.assurance import NOTHING, Gain, Information, examining, ranking, remedies
from vgtjax.estimation import Computation, foreseen, run_alone, run_together

from ...fit.plan import plan
from ...output.console import console, say_notes
from ...output.files import REPORT, SUMMARY, write_json, write_text
from ...resumable import Folders, run_units
from ...study.models import taken_for_exact
from ...study.units import Job, Unit, prepare
from .report import render, render_overview

SHOWN = 5
"""Rows of the table of runs that the terminal shows."""


@dataclasses.dataclass(frozen=True, eq=False)
class Checked:
    """What the traces of a unit can tell, and what the next run would bring; `error` says why nothing is known, and
    `exact` what errors take for exact."""

    known: Information | None
    gains: list[Gain]
    error: str | None = None
    exact: Sequence[str] = ()

    @property
    def sentences(self) -> list[str]:
        """What they can't tell, and what would help."""
        if self.known is None:
            return [f"nothing is known: {self.error}"]
        return [*self.known.sentences, *remedies(self.known, self.gains)]

    def summary(self) -> dict[str, Any]:
        """Relative errors, `None` for what is not estimable."""
        if self.known is None:
            return {"error": self.error}
        nothing = {} if self.known.tells else {"error": NOTHING}
        return {
            **self.known.summary(),
            "next": [gain.summary() for gain in self.gains],
            "sentences": [*self.sentences, *self.exact],
            **nothing,
        }


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path | None) -> None:
    """Says what can be known; with `out` writes `summary.json` and `report.html`, with units a folder each.

    **Raises:** `SimulationError` when the traces of a unit determine nothing.
    """
    job = prepare(study, parameters, to_fit=True)
    for unit in job.units:
        plan(job, unit)
    if out is None:
        for unit in job.units:
            say_notes(trace for _, trace in unit.traces)
        found = _check(job.units, job)
        bad = {name: checked.summary().get("error") for name, checked in found.items()}
    else:
        compute, overview = functools.partial(_check_units, job), functools.partial(render_overview, job)
        bad = {name: each.get("error") for name, each in run_units(job, out, "check", compute, overview).items()}
    reasons = [f"{name or 'this study'}: {error}" for name, error in bad.items() if error is not None]
    if reasons:
        raise SimulationError("; ".join(reasons))


def _check_units(job: Job, folders: Folders) -> None:
    began = time.monotonic()
    places = {unit.name: folder for unit, folder in folders}
    for name, checked in _check([unit for unit, _ in folders], job).items():
        seconds = time.monotonic() - began
        write_json(places[name] / SUMMARY, {**checked.summary(), **job.account(seconds)})
        said, exact = checked.sentences, checked.exact
        write_text(places[name] / REPORT, render(job, name, checked.known, checked.gains, said, exact, seconds))


def _check(units: list[Unit], job: Job) -> dict[str | None, Checked]:
    """The units, side by side if there are several, in their order."""
    found: dict[str | None, Checked] = {}

    def note(name: str | None, outcome: Checked | SimulationError) -> None:
        found[name] = Checked(None, [], str(outcome)) if isinstance(outcome, SimulationError) else outcome

    with console.status("what the traces tell"):
        if len(units) == 1:
            try:
                # Of what a fit would ask, its simulations side by side are all that a few steps of a search ask too.
                ahead = foreseen(plan(job, units[0]))[:1]
                note(units[0].name, run_alone(_checking(job, units[0]), ahead))
            except SimulationError as error:
                note(units[0].name, error)
        else:
            run_together({unit.name: _checking(job, unit) for unit in units}, note)
    for unit in units:
        _say(unit.name, found[unit.name])
    return {unit.name: found[unit.name] for unit in units}


def _checking(job: Job, unit: Unit) -> Computation[Checked]:
    task = plan(job, unit)
    known = yield from examining(task)
    return Checked(known, (yield from ranking(task, known)), exact=taken_for_exact(task))


def _say(name: str | None, checked: Checked) -> None:
    who = "" if name is None else f"{name}: "
    for sentence in (*checked.sentences, *checked.exact):
        console.print(f"{who}{sentence}")
    if checked.known is None:
        return
    console.print(f"{who}expected relative errors, the largest first:")
    for entry, error in sorted(checked.known.errors.items(), key=lambda pair: -pair[1]):
        console.print(f"{who}  {entry:42s} {'not determined' if error == float('inf') else f'{100 * error:.3g} %'}")
    if checked.gains:
        console.print(f"{who}runs to record next, by the factor by which errors fall:")
        for gain in checked.gains[:SHOWN]:
            most = ", ".join(
                f"{entry} {100 * before:.2g} to {100 * after:.2g} %" for entry, (before, after) in gain.lowers.items()
            )
            console.print(f"{who}  {gain.factor:5.2f}  {gain.run.label}: {most}")
