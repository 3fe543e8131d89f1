"""Gauss and Newton's method on the cost of many closed loops, every step inside the conditions of the design."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ._problem import CaseCosts, TuningProblem
from ._quadratic import QuadraticModel, model_at
from ._remembered import linearise_remembered

FIRST_RADIUS, SMALLEST_RADIUS, LARGEST_RADIUS = 0.5, 0.08, 2.0
"""Of a step in the coordinates, where 0.7 doubles one positive gain. A bolder first step may end in a worse valley;
below the smallest, chance decides which of two costs is lower."""
LENGTHS = (2.0, 1.0, 0.5, 0.25)
"""Steps that are tried side by side, in parts of the radius."""
CUT = 1 / 8
"""Of the radius after none of those was cheap enough."""
SLACK = 2e-2
"""Part of the cost that a step may lose: chance makes some places cheaper than all around them, and a step that must
gain would stay there."""
STALL = 3
"""Steps after which a search that gained little is at an end."""
STALLED = 2e-2
"""Steps that together gained less than this part are no progress: another noise changes as much."""
MAX_ITERATIONS = 60


@dataclasses.dataclass(frozen=True)
class TuningProgress:
    """Where tuning stands after a step; enough to resume it.

    `coordinates` are the best so far, of the problem's transform, and `here` those of the last step; `memories` the
    place of each closed loop's in the problem's; `history` is the best cost after every iteration, the start first.
    `restarts` counts how often memories and radius were restarted, last after iteration `restarted`; `trials` counts
    evaluations, `failed` those at which a closed loop left the finite numbers.
    """

    coordinates: tuple[float, ...]
    here: tuple[float, ...]
    memories: tuple[int, ...]
    radius: float = FIRST_RADIUS
    restarts: int = 0
    restarted: int = 0
    iteration: int = 0
    trials: int = 0
    failed: int = 0
    converged: bool = False
    verdict: str = ""
    history: tuple[float, ...] = ()

    @property
    def cost(self) -> float:
        """`J` at the best coordinates."""
        return self.history[-1]

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted; `verdict` says why."""
        return bool(self.verdict)


@dataclasses.dataclass(frozen=True, eq=False)
class _Found:
    """What a step leads to."""

    coordinates: Float[np.ndarray, " gains"]
    cost: float
    cases: CaseCosts


class Tuner:
    """Tuning under way, one step at a time; the manual's page on control says what a step does.

    `cases` are the costs at the best coordinates.

    **Arguments:** `start`: the last progress of an interrupted run; by default the gains that the controller has.

    **Raises:** `SimulationError` when a closed loop fails with the start's gains.
    """

    def __init__(self, problem: TuningProblem, start: TuningProgress | None = None):
        self.problem = problem
        here, middle = tuple(problem.start.tolist()), len(problem.memories) // 2
        began = TuningProgress(here, here, (middle,) * len(problem.cases))
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
        """One step, or the finding that these derivatives lead nowhere."""
        here = np.asarray(self.progress.here)
        at, memories = linearise_remembered(self.problem, here, np.asarray(self.progress.memories))
        if not np.any(at.slopes):
            why = "no derivative with respect to a free gain is finite and other than zero; free others"
            return self._end(why, converged=False)
        self._change(memories=tuple(memories.tolist()))
        found = self._search(model_at(self.problem, here, at))
        if found is not None:
            self._accept(found)
        now = self.progress
        if now.iteration >= MAX_ITERATIONS:
            return self._end(f"not converged after {MAX_ITERATIONS} iterations", converged=False)
        since = now.iteration - now.restarted
        if found is None or (since >= STALL and self._gained(STALL) < STALLED):
            return self._restart(since)
        return now

    def _search(self, model: QuadraticModel) -> "_Found | None":
        """The lowest cost that the model leads to, near the radius or, cut once, nearer; kept for the next step."""
        for _ in range(2):
            radius = self.progress.radius
            found = self._try(np.stack([model.propose(self.problem, length * radius) for length in LENGTHS]))
            if found.cost < (1 + SLACK) * model.cost:
                return found
            self._change(radius=max(CUT * radius, SMALLEST_RADIUS))
            if radius == SMALLEST_RADIUS:
                break
        return None

    def _try(self, candidates: Float[np.ndarray, "candidates gains"]) -> _Found:
        """The best of several, simulated side by side."""
        cases, before = self.problem.evaluate_all(candidates), self.progress
        costs = [self.problem.combine(case.costs) for case in cases]
        failed = sum(bool(np.any(case.failed)) for case in cases)
        self._change(trials=before.trials + len(cases), failed=before.failed + failed)
        best = int(np.argmin(costs))
        return _Found(candidates[best], costs[best], cases[best])

    def _accept(self, found: _Found) -> None:
        before, here = self.progress, tuple(found.coordinates.tolist())
        moved, better = float(np.linalg.norm(np.subtract(here, before.here))), found.cost < before.cost
        if better:
            self.cases = found.cases
        self._change(
            coordinates=here if better else before.coordinates,
            here=here,
            radius=min(max(moved, SMALLEST_RADIUS), LARGEST_RADIUS),
            iteration=before.iteration + 1,
            history=(*before.history, min(found.cost, before.cost)),
        )

    def _gained(self, steps: int) -> float:
        """What the last steps together took off the cost, as a part of it."""
        history = self.progress.history
        return 1 - history[-1] / history[-1 - steps]

    def _restart(self, since: int) -> TuningProgress:
        """A fresh start from the best so far after so many steps, or the end if the last one gained nothing."""
        now = self.progress
        if now.restarts and self._gained(since) < STALLED:
            return self._end(f"restarted, tuning lowers the cost by less than {STALLED:.0%}")
        short = max(len(self.problem.memories) - 2, 0)  # but one: one notch is left to those that shake
        memory = 0 if np.mean(now.memories) > short / 2 else short
        self._change(
            here=now.coordinates,
            memories=(memory,) * len(now.memories),
            radius=FIRST_RADIUS,
            restarts=now.restarts + 1,
            restarted=now.iteration,
        )
        return self.progress

    def _end(self, why: str, converged: bool = True) -> TuningProgress:
        self._change(verdict=why, converged=converged)
        return self.progress

    def _change(self, **changes: Any) -> None:
        self.progress = dataclasses.replace(self.progress, **changes)
