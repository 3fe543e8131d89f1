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

LONGEST_STEP = 1.5
"""Of a coordinate at once: a factor of 4.5 of a positive gain."""
CONVERGED = 1e-3
"""Tuning has converged when the model promises less than this part of the cost: far below what another noise does."""
STALL, STALLED = 4, 5e-3
"""It has also converged when so many steps together gained less than this part. Laws that switch leave kinks, and a
slope that no step follows."""
MAX_REJECTED = 4
"""Steps in a row that raised the cost, each damped more, after which derivatives say nothing more."""
FIRST_DAMPING = 0.1
TRUSTED = 1e-3
"""Below this damping the curvature is taken in proportion to it. Where derivatives shake more than the cost does, as
of a loop that hunts, Gauss and Newton's curvature is far too high, and steps that gain more than it promised say so."""
BOLDEST = TRUSTED / 64
MAX_ITERATIONS = 60


@dataclasses.dataclass(frozen=True)
class TuningProgress:
    """Where tuning stands after a step; enough to resume it.

    `coordinates` are the accepted ones of the problem's transform, `stage` is the number of the memory of derivatives
    that is in use since iteration `stage_began`, `history` the cost after every iteration, the start first. `failed`
    counts steps at which a closed loop left the finite numbers.
    """

    coordinates: tuple[float, ...]
    damping: float = FIRST_DAMPING
    stage: int = 0
    stage_began: int = 0
    iteration: int = 0
    rejected_in_a_row: int = 0
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


class Tuner:
    """Tuning under way, one step at a time.

    A step minimises the quadratic model of `J` that Gauss and Newton's method makes of every closed loop's residuals
    (convex composite: the model keeps the curvature of the power mean), damped as by Levenberg and Marquardt, within
    the bounds and the conditions of the design. These cost nothing to evaluate, so each step solves them as they are,
    by SciPy's SLSQP: no gain outside them is ever simulated. A step at which a closed loop fails is rejected.

    **Arguments:** `start`: the last progress of an interrupted run; by default the gains that the controller has.

    **Raises:** `SimulationError` when a closed loop fails with the start's gains.
    """

    def __init__(self, problem: Problem, start: TuningProgress | None = None):
        self.problem = problem
        self.progress = TuningProgress(tuple(problem.start.tolist())) if start is None else start
        self._here = problem.linearise(np.asarray(self.progress.coordinates), self._memory)
        cost = problem.combine(self._here.cases.costs)
        if not np.isfinite(cost):
            failed = [str(problem.cases.labels[i]) for i in np.flatnonzero(~np.isfinite(self._here.cases.costs))]
            raise SimulationError(
                f"{len(failed)} closed loops leave the finite numbers with the start's gains, the first of them "
                f"'{failed[0]}'; start from gains that are stable there"
            )
        if start is None:
            self.progress = dataclasses.replace(self.progress, history=(cost,))

    @property
    def cases(self) -> CaseCosts:
        """Costs at the accepted coordinates."""
        return self._here.cases

    def step(self) -> TuningProgress:
        """Tries one step, and says where tuning stands then."""
        before = self.progress
        here = np.asarray(before.coordinates)
        if not self._here.is_finite:
            self._end_stage("derivatives of a closed loop leave the finite numbers")
            return self.progress
        damping = before.damping
        move, promised = self._propose(here, damping)
        while promised < CONVERGED * before.cost and damping > BOLDEST and not before.rejected_in_a_row:
            damping /= 4
            move, promised = self._propose(here, damping)
        if promised < CONVERGED * before.cost:
            self._end_stage(f"a further step promises less than {CONVERGED:.1%} of the cost")
            return self.progress
        trial = self.problem.linearise(here + move, self._memory)
        cost = self.problem.combine(trial.cases.costs)
        accepted = bool(cost < before.cost)
        if accepted:
            self._here = trial
        ratio = (before.cost - cost) / promised if promised > 0 else -np.inf
        self.progress = TuningProgress(
            coordinates=tuple((here + move).tolist()) if accepted else before.coordinates,
            damping=_next_damping(damping, ratio, before.rejected_in_a_row),
            stage=before.stage,
            stage_began=before.stage_began,
            iteration=before.iteration + 1,
            rejected_in_a_row=0 if accepted else before.rejected_in_a_row + 1,
            failed=before.failed + bool(np.any(trial.cases.failed)),
            history=(*before.history, cost if accepted else before.cost),
        )
        self._judge(accepted)
        return self.progress

    def _judge(self, accepted: bool) -> None:
        """Ends a stage that has come to its end."""
        now = self.progress
        if now.iteration >= MAX_ITERATIONS:
            self.progress = dataclasses.replace(now, verdict=f"not converged after {MAX_ITERATIONS} iterations")
        elif now.rejected_in_a_row >= MAX_REJECTED:
            self._end_stage(f"{MAX_REJECTED} steps in a row raised the cost: derivatives no longer tell where it falls")
        elif accepted and now.iteration - now.stage_began >= STALL and 1 - now.cost / now.history[-1 - STALL] < STALLED:
            self._end_stage(f"the last {STALL} steps lowered the cost by less than {STALLED:.1%}")

    def _end_stage(self, why: str) -> None:
        """Goes on with derivatives of the next memory, or ends."""
        now = self.progress
        if now.stage + 1 == len(self.problem.memories):
            lowered = now.cost < now.history[0]
            settled = self._here.is_finite and now.rejected_in_a_row < MAX_REJECTED
            self.progress = dataclasses.replace(now, verdict=why, converged=lowered or settled)
            return
        self.progress = dataclasses.replace(
            now, stage=now.stage + 1, stage_began=now.iteration, damping=FIRST_DAMPING, rejected_in_a_row=0
        )
        self._here = self.problem.linearise(np.asarray(now.coordinates), self._memory)

    @property
    def _memory(self) -> float:
        return self.problem.memories[self.progress.stage]

    def _propose(self, here: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
        """The step that the model likes best, and what it promises."""
        slope, curvature = quadratic_model(self.problem, self._here)
        curvature = min(1.0, damping / TRUSTED) * curvature
        scale = np.maximum(np.diag(curvature), 1e-3 * np.max(np.diag(curvature)) + np.finfo(float).tiny)
        damped, size = curvature + damping * np.diag(scale), self.problem.combine(self._here.cases.costs)
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


def _next_damping(damping: float, ratio: float, rejected: int) -> float:
    """After a step that gained `ratio` times what was promised, and as many rejected ones before it."""
    if ratio < 0.25:
        return 4 * 2**rejected * damping
    if damping <= TRUSTED:
        # Bolder than the model only as long as it promises too little.
        return max(BOLDEST, damping / 4) if ratio > 1.5 else min(TRUSTED, 2 * damping) if ratio < 0.75 else damping
    # What has just been rejected is not tried again at once.
    return damping / 4 if ratio > 0.75 and not rejected else damping


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
