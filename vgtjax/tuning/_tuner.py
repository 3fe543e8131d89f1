"""Tuning under way: steps by derivatives, and steps by costs alone where those gain more."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ._problem import TuningProblem
from ._quadratic import Kept, QuadraticModel, model_at
from ._remembered import linearise_remembered
from ._scatter import scatter

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
BATCHES = 3
"""Of candidates in a step by costs alone: about as much work as derivatives and their trials."""
WIDER, NARROWER = 1.4, 0.8
"""What a batch that gained, and one that did not, make of the reach of the next."""
HOPED = (1.0, 0.2)
"""What a step by derivatives, and one by costs alone, is thought to gain before one was made: the first of all has
derivatives, and costs alone are asked when those gain little."""
OTHERS = 0.5
"""Of what a step gained is what one of the other kind is thought to gain at least: the place is another."""
SMALLEST_REACH = 0.15
"""Of candidates by costs alone."""
STALL = 6
"""Steps after which a search that gained little is at an end; after a third of them the other kind has its turn."""
STALLED = 2e-2
"""Steps that together gained less than this part are no progress: another noise changes as much."""
MAX_ITERATIONS = 60


@dataclasses.dataclass(frozen=True)
class TuningProgress:
    """Where tuning stands after a step; enough to resume it.

    `coordinates` are the best so far, of the problem's transform, and `here` those of the last step; `memories` the
    place of each closed loop's in the problem's; `history` is the best cost after every step, the start first.
    `model` is the last that derivatives gave, `None` before the first.
    `radius` and `reach` bound the next step by derivatives and the next batch by costs. `hopes` are what the next
    step of either kind is thought to take off the logarithm of the cost; `kinds` says of every step whether it was by
    costs.
    `tried` and `costs` hold all gains that were simulated, the start first, no cost where a closed loop left the finite
    numbers, which `failed` counts; `linearisations` counts evaluations with derivatives.
    """

    coordinates: tuple[float, ...]
    here: tuple[float, ...]
    memories: tuple[int, ...]
    radius: float = FIRST_RADIUS
    reach: float = FIRST_RADIUS
    hopes: tuple[float, ...] = HOPED
    kinds: tuple[bool, ...] = ()
    failed: int = 0
    linearisations: int = 0
    tried: tuple[tuple[float, ...], ...] = ()
    costs: tuple[float | None, ...] = ()
    converged: bool = False
    verdict: str = ""
    history: tuple[float, ...] = ()
    model: Kept | None = None

    @property
    def iteration(self) -> int:
        """How many steps were made."""
        return len(self.kinds)

    @property
    def trials(self) -> int:
        """How many gains were simulated, beside the start's and those of derivatives."""
        return len(self.tried) - 1

    @property
    def cost(self) -> float:
        """`J` at the best coordinates."""
        return self.history[-1]

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted; `verdict` says why."""
        return bool(self.verdict)


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
                f"{len(failed)} closed loops fail with the start's gains, the first of them '{failed[0]}'; start from "
                f"gains that are stable there. {self.cases.failure}".rstrip()
            )
        if start is None:
            self.progress = dataclasses.replace(began, tried=(here,), costs=(cost,), history=(cost,))

    def step(self) -> TuningProgress:
        """One step, or the finding that these derivatives lead nowhere."""
        by_costs = self._by_costs()
        if by_costs:
            self._scatter()
        elif not self._descend():
            why = "no derivative with respect to a free gain is finite and other than zero; free others"
            return self._end(why, converged=False)
        best, before = float(np.min(self._costs())), self.progress
        gain = float(np.log(before.cost / best))
        other = max(before.hopes[not by_costs], OTHERS * gain)
        self._change(
            hopes=(other, gain) if by_costs else (gain, other),
            kinds=(*before.kinds, by_costs),
            history=(*before.history, best),
        )
        if self._stalled(STALL) and len(set(self.progress.kinds[-STALL:])) == 2:
            return self._end(f"{STALL} steps with and without derivatives lower the cost by less than {STALLED:.0%}")
        if self.progress.iteration >= MAX_ITERATIONS:
            return self._end(f"not converged after {MAX_ITERATIONS} steps", converged=False)
        return self.progress

    def _by_costs(self) -> bool:
        """Whether the next step is of the kind without derivatives: the one that is thought to gain more, but the other
        one before the search is at an end."""
        now = self.progress
        if now.model is None:
            return False
        last = now.kinds[-(STALL // 3) :]
        if self._stalled(len(last)) and len(set(last)) == 1:
            return not last[0]
        return now.hopes[True] >= now.hopes[False]

    def _stalled(self, steps: int) -> bool:
        """Whether so many steps were made, and the last of them together took little off the cost."""
        history = self.progress.history
        return len(history) > steps and history[-1] > (1 - STALLED) * history[-1 - steps]

    def _descend(self) -> bool:
        """A step by derivatives from where the last one ended; or, where none is cheap enough, back to the best and
        other memories. False where all derivatives are zero."""
        here = np.asarray(self.progress.here)
        at, memories, asked = linearise_remembered(self.problem, here, np.asarray(self.progress.memories))
        self._change(linearisations=self.progress.linearisations + asked)
        if not np.any(at.slopes):
            return False
        model = model_at(self.problem, here, at)
        self._change(memories=tuple(memories.tolist()), model=model.kept())
        if not self._search(model):
            self._restart()
        return True

    def _search(self, model: QuadraticModel) -> bool:
        """Goes to the cheapest that the model leads to near the radius or, cut once, nearer, if it is cheap enough."""
        for _ in range(2):
            radius = self.progress.radius
            candidates = np.stack([model.propose(self.problem, length * radius) for length in LENGTHS])
            cost, best = self._try(candidates)
            if cost < (1 + SLACK) * model.cost:
                moved = float(np.linalg.norm(best - model.here))
                self._change(here=tuple(best.tolist()), radius=min(max(moved, SMALLEST_RADIUS), LARGEST_RADIUS))
                return True
            self._change(radius=max(CUT * radius, SMALLEST_RADIUS))
            if radius == SMALLEST_RADIUS:
                break
        return False

    def _scatter(self) -> None:
        """A step by costs alone, from which the next one by derivatives begins at the best."""
        assert self.progress.model is not None, "the first step has derivatives"
        model = QuadraticModel.of(self.progress.model)
        for _ in range(BATCHES):
            now = self.progress
            before, trials = np.min(self._costs()), np.asarray(now.tried)
            cost, _ = self._try(scatter(self.problem, trials, self._costs(), now.reach, len(trials), model))
            reach = now.reach * (WIDER if cost < (1 - STALLED) * before else NARROWER)
            self._change(reach=min(max(reach, SMALLEST_REACH), LARGEST_RADIUS))
        if self.progress.here != self.progress.coordinates:
            self._change(here=self.progress.coordinates, radius=FIRST_RADIUS)

    def _try(self, candidates: Float[np.ndarray, "candidates gains"]) -> tuple[float, Float[np.ndarray, " gains"]]:
        """The cheapest of several, simulated side by side, and its cost; all are remembered."""
        cases, before = self.problem.evaluate_all(candidates), self.progress
        costs = [self.problem.combine(case.costs) for case in cases]
        place = int(np.argmin(costs))
        if costs[place] < np.min(self._costs()):
            self.cases = cases[place]
            self._change(coordinates=tuple(candidates[place].tolist()))
        self._change(
            tried=(*before.tried, *map(tuple, candidates.tolist())),
            costs=(*before.costs, *(cost if np.isfinite(cost) else None for cost in costs)),
            failed=before.failed + sum(bool(np.any(case.failed)) for case in cases),
        )
        return costs[place], candidates[place]

    def _costs(self) -> Float[np.ndarray, " tried"]:
        """Of all that was tried; infinite where a closed loop failed."""
        return np.array([np.inf if cost is None else cost for cost in self.progress.costs])

    def _restart(self) -> None:
        """The next step by derivatives begins at the best, with short memories if they were long, or else long ones."""
        now = self.progress
        short = max(len(self.problem.memories) - 2, 0)  # but one: one notch is left to those that shake
        memory = 0 if np.mean(now.memories) > short / 2 else short
        self._change(here=now.coordinates, memories=(memory,) * len(now.memories), radius=FIRST_RADIUS)

    def _end(self, why: str, converged: bool = True) -> TuningProgress:
        self._change(verdict=why, converged=converged)
        return self.progress

    def _change(self, **changes: Any) -> None:
        self.progress = dataclasses.replace(self.progress, **changes)
