"""A search from many starts side by side: where it ends must not depend on where it begins."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy
from jaxtyping import Bool, Float

from ..._errors import SimulationError
from ..._types import Coordinates
from ...parameters import Transform
from .._task import Task
from ..derivatives import Computation, side_by_side
from ._point import Reduced
from ._progress import Progress, StartEnded
from ._search import LevenbergMarquardt

FACTOR = 1.5
"""By which positive start values are off at most, either way; others by half of their size."""
STATED = 2.0
"""Standard deviations of what is known beforehand by which a start value is off at most."""
SEED = 2012
NEAR, SAME, PROMISE = 1e4, 9.0, 0.3
"""A search leads to a known optimum where its chi^2 is that much above it at most, its full linear step misses it by so
little of chi^2, three standard errors in any one direction, and promises that optimum's chi^2 but for so large a part
of the difference."""
REACHED = ("converged", "joined")
"""How a start ended that has found an optimum: by itself, or where the search from another one has been before."""
AT_ONCE = 8
"""Starts under way at the same time: each holds derivatives of all traces, a tenth of a gigabyte."""
TRIED = 3
"""Steps before a start may be hopeless."""
WORSE, SLOW = 3.0, 0.8
"""A start is hopeless when its cost is that much larger than the least one that another has reached, and its last step
left more than that part of it."""


@dataclasses.dataclass(frozen=True)
class Ended:
    """Where the search from one start ended: `status` is `converged`, `joined` where its linear problem leads to an
    optimum that another has found, `hopeless`, `stuck`, or `failed` and why."""

    cost: float
    steps: int
    status: str
    coordinates: tuple[float, ...] = ()

    @property
    def row(self) -> StartEnded:
        """What a progress keeps of it."""
        return StartEnded(self.cost if np.isfinite(self.cost) else None, self.steps, self.status)


@dataclasses.dataclass(frozen=True, eq=False)
class _Optimum:
    """An end that a search has reached: coordinates, the linear problem there, and what is estimable there."""

    coordinates: Coordinates
    reduced: Reduced
    estimable: Bool[np.ndarray, " coordinates"]
    cost: float

    @staticmethod
    def of(search: LevenbergMarquardt) -> "_Optimum":
        progress, known = search.progress, search.uncertainty().estimable
        return _Optimum(np.array(progress.coordinates), search.point.reduced, known, progress.cost)

    def is_ahead_of(self, search: LevenbergMarquardt) -> bool:
        """Whether the linear problem where a search stands leads here."""
        above = 2 * search.problem.count * (search.progress.cost - self.cost)
        if not -SAME < above < NEAR:
            return False
        found, here = search.uncertainty(), np.asarray(search.progress.coordinates)
        if np.any(found.estimable & ~self.estimable) or abs(above - found.gain) > SAME + PROMISE * abs(above):
            return False
        # Along what the traces do not tell, any place is as good as this one.
        onward = search.problem.transform.clip(np.where(found.estimable, here - found.values, self.coordinates))
        missed = self.reduced.columns @ (np.asarray(onward) - self.coordinates)
        return float(missed @ missed) < SAME


@dataclasses.dataclass
class _Shared:
    """What starts know of each other: the optima that were found."""

    optima: list[_Optimum] = dataclasses.field(default_factory=list)

    @property
    def least(self) -> float:
        """The least cost of an optimum."""
        return min((each.cost for each in self.optima), default=np.inf)

    def ahead_of(self, search: LevenbergMarquardt) -> _Optimum | None:
        """The optimum that a search leads to, if that is known."""
        return next((each for each in self.optima if each.is_ahead_of(search)), None)


def starts_of(task: Task, transform: Transform, count: int) -> Float[np.ndarray, "starts coordinates"]:
    """The start values, and a Sobol' sequence around them inside the bounds, `(count, coordinates)`."""
    centre = np.asarray(transform.to_coordinates(task.first_guess))
    entries = len(task.selection.entries)
    reach = np.where(transform.positive, np.log(FACTOR), FACTOR - 1)
    reach[entries:] = 0.0
    if task.prior is not None:
        precision = np.asarray(task.prior.precision)
        reach = np.where(precision > 0, STATED / np.maximum(precision, 1e-300), reach)
    sobol = scipy.stats.qmc.Sobol(len(centre), rng=np.random.default_rng(SEED))
    unit = sobol.random_base2(int(np.ceil(np.log2(max(count - 1, 1)))))[: count - 1]
    around = centre + reach * (2 * unit - 1)
    return np.array([centre, *(np.asarray(transform.clip(each)) for each in around)])


def searching_from(
    starts: Sequence[Progress],
    begin: Callable[[Progress], Computation[Any]],
    better: Callable[[Progress], Computation[Progress]],
) -> Computation[list[Ended]]:
    """Searches from all starts, some at a time.

    **Arguments:** `begin`: makes a calibration of a search at its start, as a computation; `better`: where a search had
    better begin than at a start, if anywhere.
    """
    shared = _Shared()
    return (yield from side_by_side([_searching(each, begin, better, shared) for each in starts], AT_ONCE))


def _searching(
    first: Progress,
    begin: Callable[[Progress], Computation[Any]],
    better: Callable[[Progress], Computation[Progress]],
    shared: _Shared,
) -> Computation[Ended]:
    """A search up to its end, or to where it leads to one that another has reached."""
    try:
        search = (yield from begin((yield from better(first)))).minimiser
        while not search.progress.finished:
            yield from search.steps()
            progress, reached = search.progress, shared.ahead_of(search)
            if reached is not None:
                return Ended(reached.cost, progress.iteration, "joined", tuple(reached.coordinates.tolist()))
            if _hopeless(progress, shared.least):
                return Ended(progress.cost, progress.iteration, "hopeless", progress.coordinates)
    except SimulationError as error:
        return Ended(np.inf, 0, f"failed: {error}")
    progress = search.progress
    if progress.converged:
        shared.optima.append(_Optimum.of(search))
    status = "converged" if progress.converged else "stuck"
    return Ended(progress.cost, progress.iteration, status, progress.coordinates)


def _hopeless(progress: Progress, least: float) -> bool:
    if progress.iteration < TRIED or progress.cost < WORSE * least:
        return False
    return progress.cost > SLOW * progress.history[-2]


def best_of(ended: Sequence[Ended]) -> Ended:
    """The start of the least cost that has found an optimum, or else any of the least.

    **Raises:** `SimulationError` where none could be simulated.
    """
    good = [each for each in ended if each.coordinates]
    if not good:
        raise SimulationError(f"none of {len(ended)} starts can be simulated: {ended[0].status}")
    return min(good, key=lambda each: (each.status not in REACHED, each.cost))
