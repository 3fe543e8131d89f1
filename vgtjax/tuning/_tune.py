"""Tuning by one call, and its result."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from .._printing import Cells, Printed
from ..control import AbstractController
from ..parameters import parameter_table, table_row
from ._cases import Cases
from ._objective import Objective
from ._problem import CaseCosts, TuningProblem, plan_tuning
from ._sliding_mode import Sliding, sliding
from ._smoothing import soften, soften_cases
from ._tuner import Tuner, TuningProgress


@dataclasses.dataclass(frozen=True)
class TunedGain:
    """One gain before and after tuning, in its own unit."""

    name: str
    unit: str
    start: float
    tuned: float


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Tuning(Printed):
    """A controller with tuned gains, and what tuning gained. Prints itself as a table; unpacks as the first two.

    `sliding` says whether a switching observer slides in those loops, and is `None` without one.
    `problem` holds the closed loops as they are, e.g. for `problem.simulate(problem.start, [0])`, which has the gains
    before tuning. `start_costs` and `costs` are those of the softened loops that were tuned, before and after.
    """

    controller: AbstractController
    progress: TuningProgress
    gains: tuple[TunedGain, ...]
    start_costs: CaseCosts
    costs: CaseCosts
    problem: TuningProblem

    def __iter__(self) -> Iterator[Any]:
        return iter((self.controller, self.progress))

    @property
    def sliding(self) -> Sliding | None:
        """In the tuned loops."""
        settled = self.problem.objective.settled
        return sliding(self.controller, (self.problem.cases, self.costs), settled=settled)

    def _sentences(self) -> list[str]:
        found = self.sliding
        return [] if found is None else [found.sentence]

    def _title(self) -> str:
        now, ended = self.progress, "converged" if self.progress.converged else "not converged"
        return (
            f"Tuning of {type(self.controller).__name__} on {len(self.problem.cases)} closed loops: cost "
            f"{now.history[0]:.4g} before, {now.cost:.4g} after {now.iteration} steps, {ended}: {now.verdict}"
        )

    def _tables(self) -> list[Cells]:
        rows = [(gain.name, gain.unit, f"{gain.start:.4g}", f"{gain.tuned:.4g}") for gain in self.gains]
        return [[("gain", "unit", "start", "tuned"), *rows]]


def tune(controller: AbstractController, cases: Cases, objective: Objective, **options: Any) -> Tuning:
    """Tunes the gains of a controller on some closed loops.

    Tunes what [`soften`][] and [`soften_cases`][] make of both; the controller that is returned has its own widths.

    **Arguments:** `options`: `free`, `fixed`, `bounds`, `memories`, `lanes` of [`plan_tuning`][].

    **Raises:** as [`plan_tuning`][] and [`Tuner`][].
    """
    tuner = Tuner(plan_tuning(soften(controller), soften_cases(cases), objective, **options))
    start_costs = tuner.cases
    while not tuner.progress.finished:
        tuner.step()
    problem = dataclasses.replace(tuner.problem, controller=controller, cases=cases)
    tuned = problem.controller_at(np.asarray(tuner.progress.coordinates))
    table, (before, after) = parameter_table(controller), (problem.selection.values(c) for c in (controller, tuned))
    gains = tuple(
        TunedGain(name, str(table_row(table, name).unit), float(start), float(end))
        for name, start, end in zip(problem.selection.entries, before, after, strict=True)
    )
    return Tuning(tuned, tuner.progress, gains, start_costs, tuner.cases, problem)
