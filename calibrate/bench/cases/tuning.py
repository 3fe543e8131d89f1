"""Gains of the example's controller by gradients, beside optimisers that have none, on the same cost."""

import contextlib
import time
from collections.abc import Callable

import cma
import numpy as np
import scipy.optimize

from vgtjax.tuning import Problem, Tuner

from ...tune.job import prepare_tuning
from ..table import Section, seconds, times

BUDGET = 10
"""Times that of the gradient."""
SPREAD = 0.3
"""First step of the others in the logarithm of a gain, a factor of 1.35."""
REFUSED = 1e9
"""Cost of gains outside the conditions of the design, more the further out."""


class _OutOfTimeError(Exception):
    """Ends an optimiser from inside its cost."""


class _Watched:
    """The cost of a problem as an optimiser without derivatives asks for it, and the best so far over time."""

    def __init__(self, problem: Problem, budget: float):
        self.problem, self.budget = problem, budget
        self.calls, self.best = 0, [(0.0, np.inf)]
        self.began = time.perf_counter()

    def __call__(self, coordinates: np.ndarray) -> float:
        elapsed = time.perf_counter() - self.began
        if elapsed > self.budget:
            raise _OutOfTimeError
        transform = self.problem.transform
        inside = np.clip(coordinates, transform.lower, transform.upper)
        spare = np.min(self.problem.conditions(inside), initial=0.0)
        self.calls += 1
        if spare < 0:
            return REFUSED * (1 - spare)
        cost = min(self.problem.cost(inside), REFUSED)
        if cost < self.best[-1][1]:
            self.best.append((time.perf_counter() - self.began, cost))
        return cost

    def at(self, elapsed: float) -> float:
        """Best cost so far, some seconds after the start."""
        return min(cost for when, cost in self.best if when <= elapsed)

    def reached(self, cost: float) -> float | None:
        """Seconds until a cost as low as this."""
        return next((when for when, found in self.best if found <= cost), None)


def _cma_es(cost: Callable[[np.ndarray], float], start: np.ndarray) -> None:
    cma.fmin2(cost, start, SPREAD, options={"verbose": -9, "seed": 1}, restarts=9)


def _scipy(method: str, **options: float) -> Callable[[Callable[[np.ndarray], float], np.ndarray], None]:
    def minimise(cost: Callable[[np.ndarray], float], start: np.ndarray) -> None:
        scipy.optimize.minimize(cost, start, method=method, options=options)

    return minimise


OTHERS = {
    "CMA-ES (cma)": _cma_es,
    "COBYQA (SciPy)": _scipy("COBYQA", initial_tr_radius=SPREAD, maxfev=10**6),
    "Nelder-Mead (SciPy)": _scipy("Nelder-Mead", adaptive=True, maxfev=10**6),
}


def measure() -> Section:
    """Tunes once by gradients, and gives every other optimiser ten times as long."""
    problem = prepare_tuning(None, None).smooth
    for warm_up in (problem.linearise, problem.cost, problem.conditions, problem.condition_slopes):
        warm_up(problem.start)
    began = time.perf_counter()
    tuner = Tuner(problem)
    while not tuner.progress.finished:
        tuner.step()
    spent, found = time.perf_counter() - began, tuner.progress
    columns = ("contestant", "evaluations", "time", "cost after the gradient's time", f"after {BUDGET} times", "as low")
    section = Section("Tuning a controller", _about(problem), columns)
    cost = f"{found.cost:.4g}"
    section.add("gradients (tune)", f"{found.iteration} + {found.trials}", seconds(spent), cost, cost, "1")
    for name, minimise in OTHERS.items():
        watched = _Watched(problem, BUDGET * spent)
        with contextlib.suppress(_OutOfTimeError):
            minimise(watched, problem.start)
        elapsed = time.perf_counter() - watched.began
        when = watched.reached(found.cost)
        section.add(
            name,
            str(watched.calls),
            seconds(elapsed),
            f"{watched.at(spent):.4g}",
            f"{watched.at(elapsed):.4g}",
            "never" if when is None else times(when / spent),
        )
    section.notes.append(
        f"gradient: steps and trials; {found.verdict}; an optimiser that took less than its time ended by itself"
    )
    return section


def _about(problem: Problem) -> str:
    return (
        f"{len(problem.cases)} closed loops of {problem.cases.duration:g} s at once, {len(problem.selection.entries)} "
        f"gains, cost {problem.cost(problem.start):.4g} at the start; all compiled before. The others step by "
        f"{SPREAD:g} in the logarithm of a gain, and pay for gains outside the conditions of the design. "
        "'As low' says when they had the gradient's cost, in times of the gradient's time."
    )
