"""Gauss and Newton's method on the cost of many closed loops, every step inside the conditions of the design."""

import dataclasses
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Float

from ..control import AbstractController
from ..errors import SimulationError
from .cases import Cases
from .objective import Objective
from .problem import CaseCosts, Linearisation, Problem, plan_tuning
from .smoothing import soften, soften_cases

LONGEST_STEP = 1.0
"""Of a coordinate at once: a factor of 2.7 of a positive gain."""
CONVERGED = 1e-3
"""A step that promises less than this part of the cost is not worth it: far below what another noise does."""
STALL, STALLED = 3, 5e-3
"""Derivatives of one memory are given up when so many steps together gained less than this part; tuning ends when the
best step of all memories does."""
TRIALS = 5
"""Steps of one linearisation that may raise the cost, each damped more, before its derivatives are given up."""
FIRST_DAMPING, HIGHEST_DAMPING = 0.1, 1e3
TRUSTED = 1e-3
"""Below this damping the curvature is taken in proportion to it. Where derivatives shake more than the cost does, as
of a loop that hunts, Gauss and Newton's curvature is far too high, and steps that gain more than it promised say so."""
BOLDEST = TRUSTED / 64
BOLDER = 4.0
MAX_ITERATIONS = 60


@dataclasses.dataclass(frozen=True)
class TuningProgress:
    """Where tuning stands after a step; enough to resume it.

    `coordinates` are the accepted ones of the problem's transform, `stage` is the number of the memory of derivatives
    that is in use since iteration `stage_began`, or is to be chosen anew; `history` is the cost after every iteration,
    the start first. `trials` counts evaluations, `failed` those at which a closed loop left the finite numbers.
    """

    coordinates: tuple[float, ...]
    damping: float = FIRST_DAMPING
    stage: int = 0
    stage_began: int = 0
    choosing: bool = True
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
    """A step to a lower cost, and the damping and memory that led there."""

    coordinates: np.ndarray
    cost: float
    cases: CaseCosts
    damping: float
    stage: int
    chosen: bool = False


class Tuner:
    """Tuning under way, one step at a time.

    A step minimises the quadratic model of `J` that Gauss and Newton's method makes of every closed loop's residuals
    (convex composite: the model keeps the curvature of the power mean), damped as by Levenberg and Marquardt, within
    the bounds and the conditions of the design. These cost nothing to evaluate, so each step solves them as they are,
    by SciPy's SLSQP: no gain outside them is ever simulated. The damping is searched for by the cost itself, which
    takes a fraction of the time of its derivatives; a trial at which a closed loop fails is never taken.

    At first, and whenever derivatives no longer find much, those of every memory of the problem propose a step, and the
    best of them go on.

    **Arguments:** `start`: the last progress of an interrupted run; by default the gains that the controller has.

    **Raises:** `SimulationError` when a closed loop fails with the start's gains.

    `cases` are the costs at the accepted coordinates.
    """

    def __init__(self, problem: Problem, start: TuningProgress | None = None):
        self.problem = problem
        self.progress = TuningProgress(tuple(problem.start.tolist())) if start is None else start
        self.cases = problem.evaluate(self._coordinates)
        cost = problem.combine(self.cases.costs)
        if not np.isfinite(cost):
            failed = [str(problem.cases.labels[i]) for i in np.flatnonzero(~np.isfinite(self.cases.costs))]
            raise SimulationError(
                f"{len(failed)} closed loops leave the finite numbers with the start's gains, the first of them "
                f"'{failed[0]}'; start from gains that are stable there"
            )
        if start is None:
            self.progress = dataclasses.replace(self.progress, history=(cost,))

    def step(self) -> TuningProgress:
        """One step to a lower cost; the last one finds that there is none."""
        before = self.progress
        found = None if before.choosing else self._search(before.stage, before.damping)
        if found is None:
            found = self._choose()
        if found is None or before.cost - found.cost < STALLED * before.cost * found.chosen:
            return self._finish(f"no memory of derivatives finds a cost that is lower by {STALLED:.1%}", found)
        self._accept(found)
        now = self.progress
        stalled = now.iteration - now.stage_began >= STALL and 1 - now.cost / now.history[-1 - STALL] < STALLED
        self.progress = dataclasses.replace(now, choosing=stalled)
        if now.iteration >= MAX_ITERATIONS:
            self.progress = dataclasses.replace(now, verdict=f"not converged after {MAX_ITERATIONS} iterations")
        return self.progress

    def _choose(self) -> "_Found | None":
        """The best step of all memories."""
        found = [self._search(stage, FIRST_DAMPING) for stage in range(len(self.problem.memories))]
        steps = [step for step in found if step is not None]
        return dataclasses.replace(min(steps, key=lambda step: step.cost), chosen=True) if steps else None

    def _accept(self, found: "_Found") -> None:
        before = self.progress
        self.cases = found.cases
        self.progress = dataclasses.replace(
            before,
            coordinates=tuple(found.coordinates.tolist()),
            damping=found.damping,
            stage=found.stage,
            stage_began=before.iteration if found.chosen else before.stage_began,
            iteration=before.iteration + 1,
            history=(*before.history, found.cost),
        )

    def _finish(self, why: str, found: "_Found | None") -> TuningProgress:
        if found is not None:
            self._accept(found)
        # Where no derivative was finite, nothing is known.
        self.progress = dataclasses.replace(self.progress, verdict=why, converged=self.progress.trials > 0)
        return self.progress

    @property
    def _coordinates(self) -> np.ndarray:
        return np.asarray(self.progress.coordinates)

    def _search(self, stage: int, damping: float) -> "_Found | None":
        """The best step of the derivatives of one memory; nothing where none lowers the cost."""
        here, at = self._coordinates, self.problem.linearise(self._coordinates, self.problem.memories[stage])
        best, raised = None, 0
        while at.is_finite and raised < TRIALS and BOLDEST <= damping <= HIGHEST_DAMPING:
            move, promised = self._propose(at, here, damping)
            if promised < CONVERGED * self.progress.cost:
                # A bolder step promises more.
                if best is not None or raised:
                    break
                damping /= BOLDER
                continue
            cases, cost = self._try(here + move)
            if cost < (self.progress.cost if best is None else best.cost):
                best = _Found(here + move, cost, cases, damping, stage)
                if raised:
                    break
                damping /= BOLDER
            elif best is not None:
                break
            else:
                raised += 1
                damping *= BOLDER**raised
        return best

    def _try(self, coordinates: np.ndarray) -> tuple[CaseCosts, float]:
        cases, before = self.problem.evaluate(coordinates), self.progress
        failed = before.failed + bool(np.any(cases.failed))
        self.progress = dataclasses.replace(before, trials=before.trials + 1, failed=failed)
        return cases, self.problem.combine(cases.costs)

    def _propose(self, at: Linearisation, here: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
        """The step that the model likes best, and what it promises."""
        slope, curvature = quadratic_model(self.problem, at)
        curvature = min(1.0, damping / TRUSTED) * curvature
        scale = np.maximum(np.diag(curvature), 1e-3 * np.max(np.diag(curvature)) + np.finfo(float).tiny)
        damped, size = curvature + damping * np.diag(scale), self.progress.cost
        transform, problem = self.problem.transform, self.problem
        low = np.maximum(transform.lower - here, -LONGEST_STEP)
        high = np.minimum(transform.upper - here, LONGEST_STEP)
        conditions = {
            "type": "ineq",
            "fun": lambda move: problem.conditions(here + move),
            "jac": lambda move: problem.condition_slopes(here + move),
        }
        found = scipy.optimize.minimize(
            lambda move: (slope @ move + 0.5 * move @ damped @ move) / size,
            np.zeros_like(here),
            jac=lambda move: (slope + damped @ move) / size,
            method="SLSQP",
            bounds=np.stack([low, high], 1),
            constraints=[conditions] if len(problem.conditions(here)) else [],
            options={"maxiter": 200, "ftol": 1e-10},
        )
        move = self._inside(here, np.clip(found.x, low, high))
        return move, float(-(slope @ move + 0.5 * move @ curvature @ move))

    def _inside(self, here: np.ndarray, move: np.ndarray) -> np.ndarray:
        """The step, shortened where rounding or a subproblem that was not solved took it outside."""
        for _ in range(30):
            if np.all(self.problem.conditions(here + move) >= 0):
                return move
            move = 0.5 * move
        return np.zeros_like(move)


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


def quadratic_model(
    problem: Problem, at: Linearisation
) -> tuple[Float[np.ndarray, " gains"], Float[np.ndarray, "gains gains"]]:
    """Gradient of `J`, and its Gauss-Newton curvature.

    With `J = A(l_1, l_2, ...)` and `A` convex and rising, `H = sum dA/dl_i H_i + L^T A'' L` is never negative, where
    `H_i` is twice the Gram matrix of the residuals' derivatives and `L` holds the slopes of `l_i`.
    """
    weights, bends = problem.objective.derivatives(at.cases.costs)
    slope = weights @ at.slopes
    return slope, np.einsum("c,cij->ij", weights, at.curvatures) + at.slopes.T @ bends @ at.slopes
