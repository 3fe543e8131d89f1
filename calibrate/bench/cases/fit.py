"""The whole fit of the example: this package, and SciPy's trust region with two kinds of Jacobian."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.optimize

import vgtjax
from vgtjax.estimation import CHANNELS, CHI2_TOLERANCE, FitProblem, Task, build_fit_problem, calibrate, plan_task
from vgtjax.parameters import build_transform
from vgtjax.traces import noise_level

from .. import numba_plant
from ..data import example_traces, seconds_of
from ..table import Section, seconds, times
from ..timing import interleave

_Function = Callable[[np.ndarray], np.ndarray]
MAX_EVALUATIONS = 30
STEP = 1e-3
"""Step of the finite differences in unconstrained coordinates, where one is a factor of e."""
ROUNDS = 3
COLUMNS = ("contestant", "first call", "time", "ratio", "work", "chi^2/N", "chi^2/N by vgtjax")
_OURS = "vgtjax.estimation"


@dataclasses.dataclass(frozen=True, eq=False)
class _Outcome:
    work: str
    cost: float
    coordinates: np.ndarray


def measure() -> Section:
    """Fits the example three ways from the same start to the same stopping rule."""
    task = plan_task(vgtjax.Actuator(), example_traces())
    values = task.selection.pack(task.model)
    table = vgtjax.parameter_table(task.model)
    transform = build_transform(table, task.selection.entries, np.asarray(values), task.bounds)
    problem = build_fit_problem(task.model, task.selection, transform, task.fit)
    start = np.asarray(transform.to_coordinates(values))
    plant = _NumbaProblem(problem, task)
    contestants = {
        _OURS: lambda: _calibrate(task),
        "SciPy trf, numba RK4 differences, all cores": lambda: _minimise(
            plant.residuals, plant.jacobian, start, problem.count
        ),
        "SciPy trf, exact Jacobian of vgtjax": lambda: _minimise(*_exact(problem), start, problem.count),
    }
    timings, outcomes = interleave(contestants, ROUNDS)
    residuals, _ = _exact(problem)
    begin = float(np.sum(np.square(residuals(start))))
    section = Section("Fit", _about(task, problem, begin), COLUMNS, notes=_NOTES)
    for name, timing in timings.items():
        outcome = outcomes[name]
        common = float(np.sum(np.square(residuals(outcome.coordinates))))
        cells = (seconds(timing.first), seconds(timing.median), times(timing.ratio(timings[_OURS])))
        section.add(name, *cells, outcome.work, f"{2 * outcome.cost:.6f}", f"{common:.6f}")
    return section


_NOTES = [
    "Without the time of imports. The first call compiles, later ones find that in the cache. That of vgtjax includes "
    "layout, the covariance and the simulation of all traces at the end; those of SciPy only the minimisation.",
    f"All stop when a step lowers chi^2 by less than {CHI2_TOLERANCE:g}; SciPy after {MAX_EVALUATIONS} evaluations at "
    "the latest, which its row says.",
    "All move the same unconstrained coordinates and eliminate the sensors' offsets; SciPy's x_scale is 'jac'.",
    f"Differences are one-sided with steps of {STEP:g} in these coordinates, one run of all traces per parameter.",
]


def _about(task: Task, problem: FitProblem, begin: float) -> str:
    return (
        f"{len(task.selection.entries)} parameters on {len(task.fit)} traces of {seconds_of(list(task.fit)):.1f} s "
        f"together, {problem.count:,} measurements; chi^2/N is {begin:.4g} at the start, the printed parameters. "
        f"{ROUNDS} rounds."
    )


def _calibrate(task: Task) -> _Outcome:
    progress = calibrate(task).progress
    work = f"{progress.iteration} steps"
    if not progress.converged:
        work += f", {progress.verdict}"
    return _Outcome(work, progress.cost, np.asarray(progress.coordinates))


def _minimise(residuals: _Function, jacobian: _Function, start: np.ndarray, count: int) -> _Outcome:
    found = scipy.optimize.least_squares(
        residuals,
        start,
        jac=jacobian,
        method="trf",
        x_scale="jac",
        ftol=CHI2_TOLERANCE / count,  # relative to chi^2/N, which ends near one
        xtol=None,
        gtol=None,
        max_nfev=MAX_EVALUATIONS,
    )
    work = f"{found.nfev} evaluations, {found.njev} Jacobians"
    if found.status == 0:
        work += f", capped at {MAX_EVALUATIONS}"
    return _Outcome(work, float(found.cost), np.asarray(found.x))


def _exact(problem: FitProblem) -> tuple[_Function, _Function]:
    """Residuals of this package, and their exact Jacobian."""
    return (
        lambda coordinates: np.asarray(_residuals(problem, coordinates)),
        lambda coordinates: np.asarray(_residuals_and_jacobian(problem, coordinates)[1]),
    )


# Compiled once for all rounds, as a user would.
_residuals = eqx.filter_jit(lambda problem, coordinates: problem.residuals(coordinates))
_residuals_and_jacobian = eqx.filter_jit(lambda problem, coordinates: problem.residuals_and_jacobian(coordinates))


class _NumbaProblem:
    """The same least-squares problem on the numba plant, with finite differences."""

    def __init__(self, problem: FitProblem, task: Task):
        self._transform = eqx.filter_jit(problem.transform.to_physical)
        self._traces = task.fit
        self._scale = 1 / np.sqrt(problem.count)
        self._theta = numba_plant.pack(task.model)
        self._where = [numba_plant.ENTRIES.index(entry) for entry in task.selection.entries]
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def residuals(self, coordinates: np.ndarray) -> np.ndarray:
        """Residuals in units of the noise over the root of their number, offsets eliminated."""
        found = self._run(coordinates[None])[0]
        self._last = coordinates.copy(), found
        return found

    def jacobian(self, coordinates: np.ndarray) -> np.ndarray:
        """One-sided differences; the residuals at the point itself are kept from their own call."""
        if self._last is None or not np.array_equal(self._last[0], coordinates):
            self.residuals(coordinates)
        assert self._last is not None
        moved = self._run(coordinates + STEP * np.eye(len(coordinates)))
        return (moved - self._last[1]).T / STEP

    def _run(self, coordinates: np.ndarray) -> np.ndarray:
        thetas = np.tile(self._theta, (len(coordinates), 1))
        thetas[:, self._where] = self._transform(jnp.asarray(coordinates))
        blocks: list[Any] = []
        for trace in self._traces:
            for channel, seen in zip(CHANNELS, numba_plant.simulate(thetas, trace, parallel=True), strict=True):
                measured = getattr(trace, channel)
                difference = seen - measured
                difference -= difference.mean(axis=1, keepdims=True)
                blocks.append(difference * (self._scale / noise_level(measured, channel)))
        return np.concatenate(blocks, axis=1)
