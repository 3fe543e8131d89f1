"""Gains of two controllers by this package's tuner, beside CMA-ES, which has no derivatives, on the same cost."""

import contextlib
import functools
import pathlib
import tempfile
import time
from collections.abc import Sequence

import cma
import numpy as np

from vgtjax.tuning import Tuner, TuningProblem

from ...tune.job import EXAMPLE, prepare_tuning
from ..kept import KeptRows
from ..table import Section, seconds, times
from .adaptive_gains import FORMER

UNITS = EXAMPLE.parents[1] / "fleet" / "units"

BUDGET = 6
"""Times that of the tuner."""
WITHIN = (0.2, 0.1, 0.05)
"""Parts of the lowest cost that any contestant found."""
OTHER_NOISE = range(101, 109)
"""Seeds of noise that no contestant has seen."""
SPREAD = 0.3
"""First step of CMA-ES in the logarithm of a gain, a factor of 1.35."""
REFUSED = 1e9
"""Cost of gains outside the conditions of the design, more the further out."""


class _OutOfTimeError(Exception):
    """Ends an optimiser from inside its cost."""


class _Record:
    """The best cost so far over time, and the coordinates that had it."""

    def __init__(self, coordinates: np.ndarray):
        self.began, self.spent, self.calls = time.process_time(), 0.0, ""
        self.history: list[tuple[float, float]] = []
        self.coordinates, self.cost = coordinates, np.inf

    @property
    def elapsed(self) -> float:
        """Seconds of all processors since the start, which other programs on the machine do not lengthen."""
        return time.process_time() - self.began

    def add(self, cost: float, coordinates: np.ndarray) -> None:
        """Takes note of a cost if it is the lowest so far."""
        if cost < self.cost:
            self.cost, self.coordinates = cost, np.array(coordinates)
            self.history.append((self.elapsed, cost))

    def reached(self, cost: float) -> float:
        """Seconds until a cost as low as this; infinite if it never was."""
        return next((when for when, found in self.history if found <= cost), np.inf)


class _Watched(_Record):
    """The cost of a problem as an optimiser without derivatives asks for it."""

    def __init__(self, problem: TuningProblem, budget: float):
        super().__init__(problem.start)
        self.problem, self.budget, self.count = problem, budget, 0

    def __call__(self, coordinates: np.ndarray) -> float:
        return self.together([coordinates])[0]

    def together(self, generation: Sequence[np.ndarray]) -> list[float]:
        """Costs of several candidates, whose closed loops are simulated side by side."""
        if self.elapsed > self.budget:
            raise _OutOfTimeError
        transform = self.problem.transform
        inside = [np.clip(each, transform.lower, transform.upper) for each in generation]
        spare = [float(np.min(self.problem.conditions(each), initial=0.0)) for each in inside]
        found = [REFUSED * (1 - each) for each in spare]
        admitted = [place for place, each in enumerate(spare) if each >= 0]
        if admitted:
            costs = self.problem.evaluate_all(np.stack([inside[place] for place in admitted]))
            for place, each in zip(admitted, costs, strict=True):
                found[place] = min(self.problem.combine(each.costs), REFUSED)
                self.add(found[place], inside[place])
        self.count += len(generation)
        return found


def _cma_es(problem: TuningProblem, budget: float) -> _Record:
    cost = _Watched(problem, budget)
    with contextlib.suppress(_OutOfTimeError):
        options = {"verbose": -9, "seed": 1}
        cma.fmin2(cost, problem.start, SPREAD, options=options, restarts=9, parallel_objective=cost.together)
    cost.spent, cost.calls = cost.elapsed, str(cost.count)
    return cost


STUDY = """
[components]
vane_force = "speed-map"
[population]
units = "{units}"
[control]
turbine_pressure = [0, 3.0e5]
plants = 4
duration = 5.0
settled = 1.0
cost = {{chatter = 2.0}}
"""
PROBLEMS: dict[str, tuple[str, dict[str, float | tuple[float, ...]]]] = {
    "backstepping from cautious gains": (
        "backstepping",
        {"position_gain": 20.0, "pressure_gain": 150.0, "observer.pressure_rate": 20.0},
    ),
    "adaptive backstepping from gains for other plants": ("adaptive-backstepping", FORMER),
}
"""Designs and the gains that they start from, each on four of the example's twenty turbochargers."""


def measure(keep: pathlib.Path | None = None) -> Section:
    """Tunes, and gives CMA-ES several times as long.

    **Arguments:** `keep`: a file for finished problems, from which another call goes on.
    """
    columns = ("contestant", "evaluations", "time", "cost", "with other noise", *(f"within {w:.0%}" for w in WITHIN))
    section = Section("Tuning a controller", _ABOUT, columns)
    kept = KeptRows(keep, f"{_ABOUT}{STUDY}{PROBLEMS}")
    for name in PROBLEMS:
        cells = kept.row(name, functools.partial(_contest, name))
        for begin in range(0, len(cells), len(columns)):
            section.add(*cells[begin : begin + len(columns)])
    return section


def _contest(name: str) -> tuple[str, ...]:
    """All rows of a problem, one after the other."""
    problem, unseen = _problem(name), [_problem(name, seed) for seed in OTHER_NOISE]
    start = f"{problem.cost(problem.start):.4g}", f"{_unseen(unseen, problem.start):.4g}"
    cells = [f"{name}: {len(problem.selection.entries)} gains", "", "", *start, *("" for _ in WITHIN)]
    _compile(problem)
    records = {"tune": (first := _tuned(problem))}
    records["CMA-ES (cma)"] = _cma_es(problem, BUDGET * first.spent)
    lowest = min(record.cost for record in records.values())
    for contestant, record in records.items():
        costs = f"{record.cost:.4g}", f"{_unseen(unseen, record.coordinates):.4g}"
        when = [_compared(record, first, (1 + within) * lowest) for within in WITHIN]
        cells += [f"- {contestant}", record.calls, seconds(record.spent), *costs, *when]
    return tuple(cells)


def _problem(name: str, seed: int = 0) -> TuningProblem:
    design, gains = PROBLEMS[name]
    starts = ", ".join(f'"{gain}" = {{value = {np.asarray(value).tolist()}}}' for gain, value in gains.items())
    text = f'{STUDY.format(units=UNITS)}design = "{design}"\nseed = {seed}\ngains = {{{starts}}}\n'
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "study.toml"
        path.write_text(text, encoding="utf-8")
        return prepare_tuning(path, None).smooth


def _compile(problem: TuningProblem) -> None:
    """Calls all that tuning needs once."""
    for warm_up in (problem.cost, problem.conditions, problem.condition_slopes):
        warm_up(problem.start)
    Tuner(problem).step()


def _unseen(problems: list[TuningProblem], coordinates: np.ndarray) -> float:
    """Mean cost of the same loops with other noise."""
    return float(np.mean([problem.cost(coordinates) for problem in problems]))


def _tuned(problem: TuningProblem) -> _Record:
    record = _Record(problem.start)
    tuner = Tuner(problem)
    while not tuner.progress.finished:
        progress = tuner.step()
        record.add(progress.cost, np.asarray(progress.coordinates))
    record.spent, record.calls = record.elapsed, f"{progress.linearisations} + {progress.trials}"
    return record


def _compared(record: _Record, first: _Record, cost: float) -> str:
    """When a contestant was as low: seconds of the first, times those of the others, more than so many if never."""
    when, mine = record.reached(cost), first.reached(cost)
    if record is first or not np.isfinite(mine):
        return seconds(when) if np.isfinite(when) else "never"
    return times(when / mine) if np.isfinite(when) else "never"


_ABOUT = (
    "16 closed loops around a controller that knows the mean of twenty fits to simulated traces and not its plants; "
    "everything compiled before; the first row of each is the start. Evaluations of `tune`: with derivatives, and "
    "without. Times are those of all processors. CMA-ES simulates its generations side by side, steps first by "
    f"{SPREAD:g} in the logarithm of a gain, pays for gains outside the conditions of the design, and has {BUDGET} "
    "times the tuner's time. 'Within': when each had come that close to the lowest cost that either found, in times "
    "of the tuner's."
)
