"""What tuning led to: the same closed loops before and after, as tuned and as they are, and those not tuned on."""

import dataclasses
import math
from typing import Any

import numpy as np

from vgtjax.control import Margins
from vgtjax.estimation import Estimate
from vgtjax.parameters import parameter_table, table_row
from vgtjax.tuning import (
    TERMS,
    CaseCosts,
    Sliding,
    TuningProblem,
    TuningProgress,
    gain_names,
    sliding,
    sliding_margins,
)

from ..fmu.cost import SampleCost
from ..output.closed_loops import worst_of_each
from ..output.files import finite
from ..output.margins import list_margins
from ..output.sliding import list_sliding, warnings
from ..study.parameter_file import Entry, tabulate
from .job import TuneJob


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """Closed loops of one problem with the start's gains and with the tuned ones."""

    problem: TuningProblem
    start: CaseCosts
    tuned: CaseCosts

    @property
    def costs(self) -> tuple[float, float]:
        """`J` with either."""
        return self.problem.combine(self.start.costs), self.problem.combine(self.tuned.costs)

    def worst(self) -> list[int]:
        """For each reference the case whose tuned cost is highest."""
        return worst_of_each(self.problem.cases.labels, self.tuned.costs)


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome:
    """All that the summary and the report tell."""

    progress: TuningProgress
    smooth: Comparison
    true: Comparison
    unseen: Comparison
    margins: dict[str, dict[str, Margins]]
    """Of every plant that was tuned on, with the tuned gains, where its rod slides up and down."""
    sliding: Sliding | None
    """How far the tuned observer slides in all true closed loops."""
    seconds: float

    @property
    def remarks(self) -> list[str]:
        """A sentence where gains are worse than the start's along what they were not tuned on, and one where an
        observer that switches does not slide."""
        return [*self.worse_elsewhere, *warnings(self.sliding)]

    @property
    def worse_elsewhere(self) -> list[str]:
        """A sentence where gains are worse than the start's along what they were not tuned on."""
        before, after = self.unseen.costs
        if after <= before:
            return []
        return [
            f"along what gains were not tuned on the cost rises from {before:.4g} to {after:.4g}: they are good for "
            "what they were tuned on only; tune on references like those that they will meet, steps of nearly the "
            "whole stroke among them, and on more plants and turbine pressures"
        ]

    @property
    def coordinates(self) -> np.ndarray:
        """Where tuning ended."""
        return np.asarray(self.progress.coordinates)


def compare(job: TuneJob, progress: TuningProgress, seconds: float) -> Outcome:
    """Runs every closed loop once more."""
    ends = job.smooth.start, np.asarray(progress.coordinates)
    smooth, true, unseen = (
        Comparison(problem, *[problem.evaluate(end) for end in ends]) for problem in (job.smooth, job.true, job.unseen)
    )
    names = dict.fromkeys(label.plant for label in job.true.cases.labels)
    tuned = dict.fromkeys(names, job.true.controller_at(ends[1]))
    margins = sliding_margins(tuned, job.true.cases, lanes=job.true.lanes)
    judged = ((each.problem.cases, each.tuned) for each in (true, unseen))
    slides = sliding(job.true.controller_at(ends[1]), *judged, settled=job.true.objective.settled)
    return Outcome(progress, smooth, true, unseen, margins, slides, seconds)


def summarise(
    job: TuneJob, outcome: Outcome, conditions: dict[str, float], sample: SampleCost | None
) -> dict[str, Any]:
    """The content of `summary.json`; SI units. `sample` is the cost of the controller in C, where it can be written."""
    progress, true = outcome.progress, outcome.true
    comparisons = {"tuned_on_smoothed": outcome.smooth, "tuned_on": true, "unseen": outcome.unseen}
    gap = true.costs[1] / outcome.smooth.costs[1] - 1 if math.isfinite(true.costs[1]) else math.inf
    return {
        "converged": progress.converged,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "steps_by_costs": sum(progress.kinds),
        "evaluations": len(progress.tried),  # of all closed loops: the start's gains, and those tried
        "linearisations": progress.linearisations,  # the same with derivatives
        "failed_steps": progress.failed,
        "design": job.study.control.design,
        "cost": {n: finite(dict(zip(("start", "tuned"), each.costs, strict=True))) for n, each in comparisons.items()},
        "gap": finite(gap),  # by what part the true closed loops cost more than the smoothed ones, with tuned gains
        "history": list(progress.history),
        "conditions": conditions,
        "sliding": list_sliding(outcome.sliding),
        "margins": list_margins(outcome.margins),
        "sample": None if sample is None else dataclasses.asdict(sample),
        "cases": {name: _rows(comparison) for name, comparison in comparisons.items()},
        "failed": [str(true.problem.cases.labels[i]) for i in np.flatnonzero(true.tuned.failed)],
        "failure": true.tuned.failure or None,
        "notes": [*job.notes, *outcome.remarks],
        **job.account(outcome.seconds),
    }


def _rows(comparison: Comparison) -> list[dict[str, Any]]:
    return [
        dataclasses.asdict(label) | {"start": _numbers(comparison.start, i), "tuned": _numbers(comparison.tuned, i)}
        for i, label in enumerate(comparison.problem.cases.labels)
    ]


def _numbers(costs: CaseCosts, i: int) -> dict[str, Any]:
    terms = dict(zip(TERMS, costs.terms[i], strict=True))
    return finite({"cost": costs.costs[i], "terms": terms, "rms": costs.rms[i], "peak": costs.peak[i]})


def gain_entries(job: TuneJob, coordinates: np.ndarray) -> list[Entry]:
    """Every gain of the design, free and fixed, and what else the study states of it, beside its start.

    One that moves no error is not identifiable.
    """
    start, tuned = job.true.controller, job.true.controller_at(coordinates)
    states = job.true.at_bound(coordinates).tolist(), job.smooth.moves_errors(coordinates).tolist()
    table, selection = parameter_table(tuned), job.true.selection
    found = {
        name: Estimate(value, str(table_row(table, name).unit), at_bound=is_end, determined=moves)
        for name, value, is_end, moves in zip(selection.entries, selection.values(tuned).tolist(), *states, strict=True)
    }
    # Of a vector that is stated by entry all of it, as its file must have.
    names = dict.fromkeys([*gain_names(start), *(name.partition("[")[0] for name in job.study.control.gains)])
    return tabulate(start, tuned, found, job.bounds, [*names])
