"""Which parts of which traces a first search had better run on: those that tell most for the time that they take."""

import numpy as np
from jaxtyping import Float

from .._least_squares import finite_columns
from .._task import Task
from ..derivatives import CHANNELS, SEGMENT
from ._search import LevenbergMarquardt

FEW = 40_000
"""Steps of the simulation of all traces together from which a search is worth fewer of them: 20 s at 1 kHz."""
COARSER = 10.0
"""By how much errors of estimation may be larger with less of the traces."""
PARTS = 8
"""Parts of a trace, any number of which may be simulated from its start."""
UNKNOWN = 1e-8
"""Information on each coordinate, as a part of that of all traces, before any was seen."""

Information = Float[np.ndarray, "coordinates coordinates"]


def most_telling(task: Task, search: LevenbergMarquardt) -> dict[int, int]:
    """Numbers of traces, and how many of their samples from the start on, that leave errors not much larger than all of
    them do, by what they tell at the start of a search.

    One part after the other, those which add most to the determinant of the information for their length: a D-optimal
    design (Fedorov, 1972), as far as a choice of one at a time leads to it.
    """
    samples = [len(trace.time) for trace in task.fit]
    substeps = [_substeps(task, number) for number in range(len(samples))]
    if np.dot(samples, substeps) <= FEW:
        return dict(enumerate(samples))
    ends = [SEGMENT * np.unique(np.linspace(0, -(-count // SEGMENT), PARTS + 1).astype(int)) for count in samples]
    grams = _information(search, ends)
    known = UNKNOWN * np.eye(len(grams[0][0]))
    allowed = COARSER * _errors(known + sum(each[-1] for each in grams))
    seen = [0] * len(ends)
    while np.any(_errors(known) > allowed):
        rates = {
            (number, part): (_volume(known + grams[number][part] - grams[number][seen[number]]) - _volume(known))
            / (substeps[number] * (ends[number][part] - ends[number][seen[number]]))
            for number, count in enumerate(seen)
            for part in range(count + 1, len(ends[number]))
        }
        if not rates:
            break
        number, part = max(rates, key=rates.__getitem__)
        known, seen[number] = known + grams[number][part] - grams[number][seen[number]], part
    return {n: min(int(ends[n][part]), samples[n]) for n, part in enumerate(seen) if part} or dict(enumerate(samples))


def _substeps(task: Task, number: int) -> int:
    return int(task.steps.plan(task.model, task.fit[number]).substeps)


def _information(search: LevenbergMarquardt, ends: list[np.ndarray]) -> list[list[Information]]:
    """What each trace tells of the coordinates up to each of some samples, in units of what all of them tell."""
    owner = search.problem.owner
    columns = finite_columns(search.point.columns[: len(owner)])
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0, lengths, 1.0)
    found = []
    for number, each in enumerate(ends):
        mine = scaled[owner == number].reshape(-1, len(CHANNELS), scaled.shape[1])
        found.append([_beside_offsets(mine[:end]) for end in each])
    return found


def _beside_offsets(columns: Float[np.ndarray, "time channel coordinates"]) -> Information:
    """What columns tell where each channel has an offset that is not known."""
    varying = columns - np.mean(columns, axis=0, keepdims=True) if len(columns) else columns
    flat = varying.reshape(-1, columns.shape[-1])
    return flat.T @ flat


def _volume(information: Information) -> float:
    return float(np.linalg.slogdet(information)[1])


def _errors(information: Information) -> Float[np.ndarray, " coordinates"]:
    return np.sqrt(np.diag(np.linalg.inv(information)))
