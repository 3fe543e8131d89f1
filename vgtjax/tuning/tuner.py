"""Gauss and Newton's method on the cost of many closed loops, every step inside the conditions of the design."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from ..control import AbstractController
from ..errors import SimulationError
from .cases import Cases
from .objective import Objective
from .problem import CaseCosts, Problem, plan_tuning
from .quadratic import QuadraticModel, model_at
from .remembered import linearise_remembered
from .smoothing import soften, soften_cases

FIRST_RADIUS, LARGEST_RADIUS = 0.3, 1.0
"""Of a step in each coordinate: factors of 1.35 and 2.7 of a positive gain. Longer first steps end where loops hunt and
derivatives tell little."""
FIRST_DAMPING, LOWEST_DAMPING, HIGHEST_DAMPING = 0.1, 1e-5, 1e3
BOLD = (1 / 64, 1 / 8, 1.0, 8.0)
"""Dampings that are tried side by side, in parts of the one that was best before."""
CAREFUL = (1 / 50, 0.3, 4.0, 64.0)
"""The same after none of those lowered the cost, within a radius that is cut by `CUT`."""
ATTEMPTS, CUT, GROWTH = 3, 0.4, 1.5
LOWER = 1e-4
"""Part of the cost that a step must gain."""
STALL, STALLED = 3, 2e-2
"""Steps that together gained less than this part are no progress: another noise changes as much."""
MAX_ITERATIONS = 60


@dataclasses.dataclass(frozen=True)
class TuningProgress:
    """Where tuning stands after a step; enough to resume it.

    `coordinates` are the accepted ones of the problem's transform, `memories` the place of each closed loop's in the
    problem's; `history` is the cost after every iteration, the start first. `renewals` counts how often memories,
    damping and radius were begun anew, last after iteration `renewed`; `trials` counts evaluations, `failed` those at
    which a closed loop left the finite numbers.
    """

    coordinates: tuple[float, ...]
    memories: tuple[int, ...]
    damping: float = FIRST_DAMPING
    radius: float = FIRST_RADIUS
    renewals: int = 0
    renewed: int = 0
    iteration: int = 0
    trials: int = 0
    failed: int = 0
    converged: bool = False
    verdict: str = ""
    history: tuple[float, ...] = ()

    @property
    def cost(self) -> float:
        """`J` at the accepted coordinates."""
        return self.history[-1]

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted; `verdict` says why."""
        return bool(self.verdict)


@dataclasses.dataclass(frozen=True, eq=False)
class _Found:
    """A step to a lower cost."""

    coordinates: Float[np.ndarray, " gains"]
    cost: float
    cases: CaseCosts
    damping: float


class Tuner:
    """Tuning under way, one step at a time.

    A step minimises the quadratic model of `J` that Gauss and Newton's method makes of every closed loop's residuals,
    damped, within a radius, the bounds and the conditions of the design. These cost nothing to evaluate, so each step
    solves them as they are: no gain outside them is ever simulated. Several dampings are simulated side by side, and
    the lowest cost is taken; a trial at which a closed loop fails never is.

    Each closed loop has derivatives of its own memory, the longest of the problem's with which they do not shake: all
    of them where the loop is calm, and a short one where it hunts. Where steps gain nothing more, all loops begin anew
    with short memories if they were long, and else with long ones; tuning ends where that gains nothing either.

    **Arguments:** `start`: the last progress of an interrupted run; by default the gains that the controller has.

    **Raises:** `SimulationError` when a closed loop fails with the start's gains.

    `cases` are the costs at the accepted coordinates.
    """

    def __init__(self, problem: Problem, start: TuningProgress | None = None):
        self.problem = problem
        began = TuningProgress(tuple(problem.start.tolist()), (0,) * len(problem.cases))
        self.progress = began if start is None else start
        self.cases = problem.evaluate(np.asarray(self.progress.coordinates))
        cost = problem.combine(self.cases.costs)
        if not np.isfinite(cost):
            failed = [str(problem.cases.labels[i]) for i in np.flatnonzero(~np.isfinite(self.cases.costs))]
            raise SimulationError(
                f"{len(failed)} closed loops leave the finite numbers with the start's gains, the first of them "
                f"'{failed[0]}'; start from gains that are stable there"
            )
        if start is None:
            self.progress = dataclasses.replace(began, history=(cost,))

    def step(self) -> TuningProgress:
        """One step to a lower cost, or the finding that these derivatives lead to none."""
        here = np.asarray(self.progress.coordinates)
        at, memories = linearise_remembered(self.problem, here, np.asarray(self.progress.memories))
        if not np.any(at.slopes):
            why = "no derivative by a free gain is finite and other than zero; free others, or start from calmer gains"
            return self._end(why, converged=False)
        self._change(memories=tuple(memories.tolist()))
        found = self._search(model_at(self.problem, here, at))
        if found is not None:
            self._accept(found)
        now = self.progress
        if now.iteration >= MAX_ITERATIONS:
            return self._end(f"not converged after {MAX_ITERATIONS} iterations", converged=False)
        since = now.iteration - now.renewed
        if found is None or (since >= STALL and self._gained(STALL) < STALLED):
            return self._renew(since)
        return now

    def _search(self, model: QuadraticModel) -> "_Found | None":
        """The lowest cost that the model leads to; its radius and damping are kept for the next step."""
        for attempt in range(ATTEMPTS):
            now = self.progress
            parts = np.asarray(CAREFUL if attempt else BOLD)
            dampings = np.clip(now.damping * parts, LOWEST_DAMPING, HIGHEST_DAMPING)
            candidates = np.stack([model.propose(self.problem, damping, now.radius) for damping in dampings])
            found = self._try(candidates, dampings)
            if found.cost < (1 - LOWER) * model.cost:
                return found
            self._change(radius=CUT * now.radius, damping=min(16 * now.damping, HIGHEST_DAMPING))
        return None

    def _try(
        self, candidates: Float[np.ndarray, "candidates gains"], dampings: Float[np.ndarray, " candidates"]
    ) -> _Found:
        """The best of several, simulated side by side."""
        cases, before = self.problem.evaluate_all(candidates), self.progress
        costs = [self.problem.combine(case.costs) for case in cases]
        failed = sum(bool(np.any(case.failed)) for case in cases)
        self._change(trials=before.trials + len(cases), failed=before.failed + failed)
        best = int(np.argmin(costs))
        return _Found(candidates[best], costs[best], cases[best], float(dampings[best]))

    def _accept(self, found: _Found) -> None:
        before, self.cases = self.progress, found.cases
        moved, radius = np.max(np.abs(found.coordinates - np.asarray(before.coordinates))), before.radius
        if moved > 0.9 * radius:
            radius = min(GROWTH * radius, LARGEST_RADIUS)
        elif moved < 0.3 * radius:
            radius = max(2 * moved, 0.02)
        self._change(
            coordinates=tuple(found.coordinates.tolist()),
            damping=found.damping,
            radius=float(radius),
            iteration=before.iteration + 1,
            history=(*before.history, found.cost),
        )

    def _gained(self, steps: int) -> float:
        """What the last steps together took off the cost, as a part of it."""
        history = self.progress.history
        return 1 - history[-1] / history[-1 - steps]

    def _renew(self, since: int) -> TuningProgress:
        """A fresh start from here after so many steps of the last one, or the end if that has gained nothing."""
        now = self.progress
        if now.renewals and self._gained(since) < STALLED:
            return self._end(f"derivatives of long and short memory lower the cost by less than {STALLED:.0%}")
        short = _short(self.problem)
        memory = 0 if np.mean(now.memories) > short / 2 else short
        self._change(
            memories=(memory,) * len(now.memories),
            damping=FIRST_DAMPING,
            radius=FIRST_RADIUS,
            renewals=now.renewals + 1,
            renewed=now.iteration,
        )
        return self.progress

    def _end(self, why: str, converged: bool = True) -> TuningProgress:
        self._change(verdict=why, converged=converged)
        return self.progress

    def _change(self, **changes: Any) -> None:
        self.progress = dataclasses.replace(self.progress, **changes)


def _short(problem: Problem) -> int:
    """Place of the last memory but one: one notch is left to those that shake."""
    return max(len(problem.memories) - 2, 0)


def tune(
    controller: AbstractController, cases: Cases, objective: Objective, **options: Any
) -> tuple[AbstractController, TuningProgress]:
    """A controller with gains tuned for some closed loops, and how tuning ended.

    Tunes what [`soften`][] and [`soften_cases`][] make of both; the controller that is returned has its own widths.

    **Arguments:** `options`: `free`, `fixed`, `bounds`, `memories`, `lanes` of [`plan_tuning`][].

    **Raises:** as [`plan_tuning`][] and [`Tuner`][].
    """
    problem = plan_tuning(soften(controller), soften_cases(cases), objective, **options)
    tuner = Tuner(problem)
    while not tuner.progress.finished:
        tuner.step()
    sharp = dataclasses.replace(problem, controller=controller)
    return sharp.controller_at(np.asarray(tuner.progress.coordinates)), tuner.progress
