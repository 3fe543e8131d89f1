"""Where a search begins, and the coordinates that it moves in."""

import collections
import dataclasses

import numpy as np
from jaxtyping import Float

from ..._types import Coordinates
from ...parameters import Transform, replace_parameters
from .._task import Task
from ..measurements import DELAY_SCALE, LONGEST_DELAY, FitProblem, SensorsOfTraces, build_fit_problem
from ._progress import Progress


def first_progress(task: Task, delay: float = 0.0) -> Progress:
    """A search at its start, with a duty that is `delay` s late; the delay is free if there is one, or the traces need
    not tell of it first."""
    late = task.late_duty and (bool(delay) or task.unknown.duty_delay is True)
    progress, guess = Progress((), late=late), np.array(task.first_guess)
    guess[-1] += delay if late else 0.0
    start = np.asarray(transform_of(task, progress).to_coordinates(guess))
    return dataclasses.replace(progress, coordinates=tuple(start.tolist()))


def transform_of(task: Task, progress: Progress) -> Transform:
    """The map between values and coordinates; what ran away is held, and a duty that is not late."""
    start = task.selection.values(task.model)
    transform = task.transform().holding(progress.held, start)
    if not task.late_duty:
        return transform
    longest = LONGEST_DELAY if progress.late else 0.0
    return transform.extended(DELAY_SCALE, -longest, longest)


def problem_of(task: Task, progress: Progress, sensors: SensorsOfTraces | None = None) -> FitProblem:
    """The problem of a search that knows so much of its sensors, or no more than that their noise is white."""
    return build_fit_problem(
        task.model,
        task.selection,
        transform_of(task, progress),
        task.traces,
        channels=task.channels,
        sensors=sensors,
        stepping=task.steps,
        prior=task.prior,
    )


def guess_of(task: Task) -> Float[np.ndarray, " entries"] | None:
    """Values of the free entries that traces tell directly, in the units of the table, NaN for others; or `None`."""
    if task.second_guess is None:
        return None
    entries, first = task.selection.entries, task.selection.values(task.model)
    found = dict(task.second_guess(task.plant, task.fit))
    free = collections.Counter(entry.partition("[")[0] for entry in entries)
    # Of a vector all numbers belong together.
    told = [np.size(found.get(name := entry.partition("[")[0], ())) == free[name] for entry in entries]
    values = task.selection.values(replace_parameters(task.model, found))
    positive = np.asarray(transform_of(task, Progress(())).positive)[: len(entries)]
    good = np.array(told) & ~(positive & (values <= 0)) & (values != first)
    return np.where(good, values, np.nan) if np.any(good) else None


def guessed(guess: Float[np.ndarray, " entries"], transform: Transform, start: Coordinates) -> Coordinates:
    """A start with the values of a second guess."""
    values = np.array(transform.to_physical(start))
    values[: len(guess)] = np.where(np.isnan(guess), values[: len(guess)], guess)
    return np.asarray(transform.clip(transform.to_coordinates(values)))
