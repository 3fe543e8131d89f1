"""Which traces a first search had better run on: those that tell most for the time that they take to simulate."""

import numpy as np
from jaxtyping import Float

from ._least_squares import finite_columns
from ._search import LevenbergMarquardt
from ._task import Task

FEW = 40_000
"""Steps of the simulation of all traces together from which a search is worth fewer of them: 20 s at 1 kHz."""
COARSER = 10.0
"""By how much errors of estimation may be larger with fewer traces: 64 starts on the seven traces of a unit take 134 s
with 10 and 170 s with 3; 63 of them end at the same optimum, and one is hopeless, where with 3 it got there too."""
UNKNOWN = 1e-8
"""Information on each coordinate, as a part of that of all traces, before any was seen."""


def most_telling(task: Task, search: LevenbergMarquardt) -> list[int]:
    """Numbers of traces that leave errors not much larger than all of them do, by what they tell at the start of a
    search.

    One after the other, that which adds most to the determinant of the information for its length: a D-optimal design
    (Fedorov, 1972), as far as a choice of one at a time leads to it.
    """
    lengths = [_steps(task, number) for number in range(len(task.fit))]
    left, chosen = dict(enumerate(lengths)), list[int]()
    if sum(lengths) <= FEW:
        return list(left)
    grams = _information(search, len(lengths))
    known = UNKNOWN * np.eye(len(grams[0]))
    allowed = COARSER * _errors(known + sum(grams))
    while left and np.any(_errors(known) > allowed):
        gains = {n: (_volume(known + grams[n]) - _volume(known)) / length for n, length in left.items()}
        best = max(gains, key=gains.__getitem__)
        del left[best]
        known, chosen = known + grams[best], [*chosen, best]
    return sorted(chosen) or list(range(len(lengths)))


def _steps(task: Task, number: int) -> int:
    trace = task.fit[number]
    return len(trace.time) * int(task.stepping.plan_intervals(task.model, trace.longest_interval).substeps)


def _information(search: LevenbergMarquardt, traces: int) -> list[Float[np.ndarray, "coordinates coordinates"]]:
    """What each trace tells of the coordinates, in units of what all of them tell."""
    owner = search.problem.owner
    columns = finite_columns(search.point.columns[: len(owner)])
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0, lengths, 1.0)
    return [scaled[owner == number].T @ scaled[owner == number] for number in range(traces)]


def _volume(information: Float[np.ndarray, "coordinates coordinates"]) -> float:
    return float(np.linalg.slogdet(information)[1])


def _errors(information: Float[np.ndarray, "coordinates coordinates"]) -> Float[np.ndarray, " coordinates"]:
    return np.sqrt(np.diag(np.linalg.inv(information)))
