"""What an end would go back by from places beside it: how the sharp model answers to moves that derivatives promise."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..._errors import SimulationError
from ..._types import Coordinates
from ...parameters import Transform
from .._least_squares import LeastSquares
from ..derivatives import Computation
from ..search import FARTHEST, AbstractCalibrator

Combinations = Float[np.ndarray, "directions coordinates"]


def holding(calibrator: AbstractCalibrator, vague: Combinations) -> LeastSquares:
    """The linear problem at a place, without what the traces hardly tell: no linear model says anything so far away."""
    search = calibrator.minimiser
    return search.point.holding(vague).uncertainty(search.problem.count)


def answers_beside(
    calibrator: AbstractCalibrator, along: Coordinates, vague: Combinations, *, least: float, most: float = 1.0
) -> Computation[list[tuple[float, Coordinates]]]:
    """Places to either side of an end, as parts of a move, and by how much the linear problem there would go back.

    A side is left out where a bound, or what a linear model reaches, is nearer than the part `least`, and where a
    simulation fails; none is farther than the part `most`.
    """
    search, found = calibrator.minimiser, []
    here = np.array(search.progress.coordinates)
    for side in (1.0, -1.0):
        reach = _reach(search.problem.transform, here, side * along, most)
        if reach < least:
            continue
        there = tuple((here + side * reach * along).tolist())
        try:
            beside = yield from calibrator.corrected(dataclasses.replace(search.progress, coordinates=there))
        except SimulationError:
            continue
        back = holding(beside, vague).values
        if np.all(np.isfinite(back)):
            found.append((side * reach, back))
    return found


def _reach(transform: Transform, here: Coordinates, along: Coordinates, most: float) -> float:
    """Which part of a move, `most` at most, keeps within the bounds, and is short enough for a linear model."""
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(along > 0, (transform.upper - here) / along, (transform.lower - here) / along)
    room = np.where(along == 0, np.inf, room)
    return float(min(most, FARTHEST / np.max(np.abs(along)), 0.99 * np.min(room)))
