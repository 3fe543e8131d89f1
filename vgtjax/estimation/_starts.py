"""A search from many starts side by side: where it ends must not depend on where it begins."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import SimulationError
from ._evaluation import Steps, side_by_side
from ._progress import Progress
from ._task import Task

FACTOR = 1.5
"""By which positive start values are off at most, either way; others by half of their size."""
STATED = 2.0
"""Standard deviations of what is known beforehand by which a start value is off at most."""
SEED = 2012
AT_ONCE = 8
"""Starts under way at the same time: each holds derivatives of all traces, a tenth of a gigabyte."""
TRIED = 3
"""Steps before a start may be hopeless."""
WORSE, SLOW = 3.0, 0.8
"""A start is hopeless when its cost is that much larger than the least one that another has reached, and its last step
left more than that part of it."""

Coordinates = Float[np.ndarray, " coordinates"]


@dataclasses.dataclass(frozen=True)
class Ended:
    """Where the search from one start ended: `status` is `converged`, `hopeless`, `failed` or why it stopped."""

    cost: float
    steps: int
    status: str
    coordinates: tuple[float, ...] = ()

    @property
    def row(self) -> tuple[float | None, int, str]:
        """What a progress keeps of it."""
        return (self.cost if np.isfinite(self.cost) else None, self.steps, self.status)


@dataclasses.dataclass
class _Shared:
    """What starts know of each other."""

    least: float = np.inf


def starts_of(task: Task, transform: Any, count: int) -> Float[np.ndarray, "starts coordinates"]:
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
    first: Progress, starts: Float[np.ndarray, "starts coordinates"], begin: Callable[[Progress], Steps[Any]]
) -> Steps[list[Ended]]:
    """Searches from all starts, some at a time.

    **Arguments:** `first`: a search at its start; `begin`: makes a calibration of that, as a computation.
    """
    shared = _Shared()
    firsts = [dataclasses.replace(first, coordinates=tuple(each.tolist())) for each in starts]
    searches = [_searching(each, begin, shared) for each in firsts]
    return (yield from side_by_side(searches, AT_ONCE))


def _searching(first: Progress, begin: Callable[[Progress], Steps[Any]], shared: _Shared) -> Steps[Ended]:
    try:
        search = (yield from begin(first)).minimiser
        while not search.progress.finished:
            yield from search.steps()
            if _hopeless(search.progress, shared.least):
                return Ended(search.progress.cost, search.progress.iteration, "hopeless", search.progress.coordinates)
    except SimulationError as error:
        return Ended(np.inf, 0, f"failed: {error}")
    progress = search.progress
    if progress.converged:
        shared.least = min(shared.least, progress.cost)
    status = "converged" if progress.converged else "stuck"
    return Ended(progress.cost, progress.iteration, status, progress.coordinates)


def _hopeless(progress: Progress, least: float) -> bool:
    if progress.iteration < TRIED or progress.cost < WORSE * least:
        return False
    return progress.cost > SLOW * progress.history[-2]


def best_of(ended: Sequence[Ended]) -> Ended:
    """The converged start of the least cost, or else any of the least.

    **Raises:** `SimulationError` where none could be simulated.
    """
    good = [each for each in ended if each.coordinates]
    if not good:
        raise SimulationError(f"none of {len(ended)} starts can be simulated: {ended[0].status}")
    return min(good, key=lambda each: (each.status != "converged", each.cost))
