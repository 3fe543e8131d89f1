"""Tuning by one call, and its result."""

import dataclasses
import itertools
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
    at_bound: bool
    moves_errors: bool
    """Whether it moves any error of the softened loops that were tuned; what moves none could be anything."""

    @property
    def remark(self) -> str:
        """What is to be said of it, nothing of most."""
        if not self.moves_errors:
            return f"{self.name} moves no error of these loops, and could be anything"
        return f"{self.name} ended at its bound" if self.at_bound else ""


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
        found, remarks = self.sliding, [gain.remark for gain in self.gains if gain.remark]
        return remarks if found is None else [*remarks, found.sentence]

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
    ended = np.asarray(tuner.progress.coordinates)
    tuned, names, table = problem.controller_at(ended), problem.selection.entries, parameter_table(controller)
    values = (problem.selection.values(each).tolist() for each in (controller, tuned))
    states = problem.at_bound(ended).tolist(), tuner.problem.moves_errors(ended).tolist()
    units = (str(table_row(table, name).unit) for name in names)
    gains = tuple(itertools.starmap(TunedGain, zip(names, units, *values, *states, strict=True)))
    return Tuning(tuned, tuner.progress, gains, start_costs, tuner.cases, problem)
