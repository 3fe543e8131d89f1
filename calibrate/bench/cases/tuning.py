"""Gains of two controllers by gradients, beside optimisers that have none, on the same cost."""

import contextlib
import pathlib
import tempfile
import time
from collections.abc import Callable

import cma
import numpy as np
import scipy.optimize

from vgtjax.tuning import Problem, Tuner, TuningProgress

from ...tune.job import EXAMPLE, prepare_tuning
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


Minimiser = Callable[[Callable[[np.ndarray], float], np.ndarray], None]


def _cma_es(cost: Callable[[np.ndarray], float], start: np.ndarray) -> None:
    cma.fmin2(cost, start, SPREAD, options={"verbose": -9, "seed": 1}, restarts=9)


def _scipy(method: str, **options: float) -> Minimiser:
    def minimise(cost: Callable[[np.ndarray], float], start: np.ndarray) -> None:
        scipy.optimize.minimize(cost, start, method=method, options=options)

    return minimise


OTHERS = {
    "CMA-ES (cma)": _cma_es,
    "COBYQA (SciPy)": _scipy("COBYQA", initial_tr_radius=SPREAD, maxfev=10**6),
    "Nelder-Mead (SciPy)": _scipy("Nelder-Mead", adaptive=True, maxfev=10**6),
}


STUDIES = {
    "backstepping from cautious gains": """
[control]
design = "backstepping"
turbine_pressure = [0, 3.0e5]
plants = 4
duration = 5.0
settled = 1.0
cost = {chatter = 2.0}
gains = {position_gain = {value = 20.0}, pressure_gain = {value = 150.0}, "observer.pressure_rate" = {value = 20.0}}
""",
    "adaptive backstepping from its defaults": """
[control]
design = "adaptive-backstepping"
turbine_pressure = [0, 3.0e5]
plants = 4
""",
}
"""What is tuned, each on four of the example's twenty turbochargers."""


def measure() -> Section:
    """Tunes by gradients, and gives every other optimiser ten times as long."""
    columns = ("contestant", "evaluations", "time", "cost after the gradient's time", f"after {BUDGET} times", "as low")
    section = Section("Tuning a controller", _ABOUT, columns)
    for name, study in STUDIES.items():
        problem = _problem(study)
        section.add(
            f"{name}: {len(problem.selection.entries)} gains", "", "", f"{problem.cost(problem.start):.4g}", "", ""
        )
        spent, found = _by_gradients(problem)
        cost = f"{found.cost:.4g}"
        section.add("- gradients (tune)", f"{found.iteration} + {found.trials}", seconds(spent), cost, cost, times(1.0))
        for other, minimise in OTHERS.items():
            section.add(f"- {other}", *_without(problem, minimise, spent, found.cost))
    return section


def _problem(study: str) -> Problem:
    units = EXAMPLE.parents[1] / "fleet" / "units"
    header = f'[components]\nvane_force = "map"\n[population]\nunits = "{units}"\n'
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "study.toml"
        path.write_text(header + study, encoding="utf-8")
        problem = prepare_tuning(path, None).smooth
    for warm_up in (problem.cost, problem.conditions, problem.condition_slopes):
        warm_up(problem.start)
    Tuner(problem).step()
    return problem


def _by_gradients(problem: Problem) -> tuple[float, TuningProgress]:
    began, tuner = time.perf_counter(), Tuner(problem)
    while not tuner.progress.finished:
        tuner.step()
    return time.perf_counter() - began, tuner.progress


def _without(problem: Problem, minimise: Minimiser, spent: float, wanted: float) -> tuple[str, ...]:
    """Cells of a row: evaluations, time, best cost after the gradient's time and in the end, when it was as low."""
    watched = _Watched(problem, BUDGET * spent)
    with contextlib.suppress(_OutOfTimeError):
        minimise(watched, problem.start)
    elapsed, when = time.perf_counter() - watched.began, watched.reached(wanted)
    early, late = f"{watched.at(spent):.4g}", f"{watched.at(elapsed):.4g}"
    return str(watched.calls), seconds(elapsed), early, late, "never" if when is None else times(when / spent)


_ABOUT = (
    "16 closed loops on all cores, everything compiled before; the first row of each is the cost of the start. "
    f"Gradients: steps and trials. The others step by {SPREAD:g} in the logarithm of a gain, pay for gains outside the "
    f"conditions of the design, and have {BUDGET} times the gradient's time, or end by themselves. 'As low': when they "
    "had the gradient's cost, in times of the gradient's time."
)
