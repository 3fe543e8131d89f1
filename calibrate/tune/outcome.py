"""What tuning led to: the same closed loops before and after, as tuned and as they are, and those not tuned on."""

import dataclasses
import math
from typing import Any

import numpy as np

from vgtjax.tuning import TERMS, CaseCosts, TuningProblem, TuningProgress

from ..population import finite
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
        labels, costs = self.problem.cases.labels, np.nan_to_num(self.tuned.costs, nan=np.inf)
        names = dict.fromkeys(label.reference for label in labels)
        return [
            max((i for i, each in enumerate(labels) if each.reference == name), key=lambda i: costs[i])
            for name in names
        ]


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome:
    """All that the summary and the report tell."""

    progress: TuningProgress
    smooth: Comparison
    true: Comparison
    unseen: Comparison
    seconds: float

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
    return Outcome(progress, smooth, true, unseen, seconds)


def summarise(job: TuneJob, outcome: Outcome, conditions: dict[str, float]) -> dict[str, Any]:
    """The content of `summary.json`; SI units."""
    progress = outcome.progress
    failed = [str(outcome.true.problem.cases.labels[i]) for i in np.flatnonzero(outcome.true.tuned.failed)]
    return {
        "converged": progress.converged,
        "verdict": progress.verdict,
        "iterations": progress.iteration,
        "failed_steps": progress.failed,
        "wall_seconds": round(outcome.seconds, 3),
        "design": job.study.control.design,
        "cost": {name: _ends(comparison) for name, comparison in _comparisons(outcome).items()},
        "gap": finite(_gap(outcome)),
        "history": list(progress.history),
        "conditions": conditions,
        "cases": {name: _rows(comparison) for name, comparison in _comparisons(outcome).items()},
        "failed": failed,
        "notes": list(job.notes),
        "study_sha256": job.fingerprint,
    }


def _comparisons(outcome: Outcome) -> dict[str, Comparison]:
    return {"tuned_on_smoothed": outcome.smooth, "tuned_on": outcome.true, "unseen": outcome.unseen}


def _gap(outcome: Outcome) -> float:
    """By what part the true closed loops cost more than the smoothed ones, with tuned gains."""
    smooth, true = outcome.smooth.costs[1], outcome.true.costs[1]
    return true / smooth - 1 if math.isfinite(true) else math.inf


def _ends(comparison: Comparison) -> dict[str, float | None]:
    return dict(zip(("start", "tuned"), map(finite, comparison.costs), strict=True))


def _rows(comparison: Comparison) -> list[dict[str, Any]]:
    return [
        {
            "plant": label.plant,
            "reference": label.reference,
            "turbine_pressure": label.turbine_pressure,
            **{
                name: {
                    "cost": finite(costs.costs[i]),
                    "terms": dict(zip(TERMS, map(finite, costs.terms[i]), strict=True)),
                    "rms": finite(costs.rms[i]),
                    "peak": finite(costs.peak[i]),
                }
                for name, costs in (("start", comparison.start), ("tuned", comparison.tuned))
            },
        }
        for i, label in enumerate(comparison.problem.cases.labels)
    ]
