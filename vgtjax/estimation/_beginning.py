"""Where a search begins, and the coordinates that it moves in."""

import dataclasses

import numpy as np

from ..parameters import Transform, build_transform, parameter_table
from ._evidence import DELAY_SCALE, LONGEST_DELAY
from ._progress import Progress
from ._task import Task


def first_progress(task: Task) -> Progress:
    """A search at its start; the delay of the duty is free if the traces need not tell of it first."""
    progress = Progress((), late=task.late_duty and task.unknown.duty_delay is True)
    start = np.asarray(transform_of(task, progress).to_coordinates(task.first_guess))
    return dataclasses.replace(progress, coordinates=tuple(start.tolist()))


def transform_of(task: Task, progress: Progress) -> Transform:
    """The map between values and coordinates; what ran away is held, and a duty that is not late."""
    start = np.asarray(task.selection.pack(task.model))
    transform = build_transform(parameter_table(task.model), task.selection.entries, start, task.bounds)
    transform = transform.holding(progress.held, start)
    if not task.late_duty:
        return transform
    longest = LONGEST_DELAY if progress.late else 0.0
    return transform.extended(DELAY_SCALE, -longest, longest)
