"""The law of a rod that slides one way between its stops, and where it rests at the closed one [2.36, 3.11, 3.12]."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Bool

from ...plants import MechanicalActuator
from .. import _limits as limits
from .._filters import Samples
from .._result import Coefficients, NotPossible
from ._motion import MotionRecord
from ._weak_form import Filtered, TraceEquations, filter_motion, regress_traces, within_stops

KERNEL = 0.1
"""s; between 0.05 and 0.2 s simulated traces give the same spring and friction within their errors."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sliding(Coefficients):
    """The law of a sliding rod, `f = F_0 + k x + F_c s + drop s exp(-|v|/v_s) + b v + m a`, `s` the direction.

    Values are by those of the names `preload, stiffness, coulomb, drop, viscous, mass` that were asked for. Arrays of
    all rows: `force` in N, `position` in m, `velocity` in m/s, `acceleration` in m/s2.
    """

    force: Samples
    position: Samples
    velocity: Samples
    acceleration: Samples

    def friction(self) -> Samples:
        """What is left of the force without spring and inertia, in N."""
        spring = self.value("preload") + self.value("stiffness") * self.position
        return self.force - spring - self.value("mass") * self.acceleration


def fit_sliding(
    model: MechanicalActuator, motions: Sequence[MotionRecord], stribeck_velocity: float | None = None
) -> Sliding:
    """Fits the law to all stretches over which the rod slides one way between the stops.

    **Arguments:** `stribeck_velocity`: `v_s` in m/s of the term that it belongs to; no such term without it.

    **Raises:** `NotPossible` when there are none.
    """
    filtered = [filter_motion(motion, KERNEL) for motion in motions]
    friction, spring, distance = model.friction.dry(), float(model.diaphragm.stiffness) > 0, 0.0
    if friction is not None and friction.bristle_stiffness is not None:
        distance = limits.MEMORY * float(friction.coulomb_force) / float(friction.bristle_stiffness)
    chosen = [_one_way(each, within_stops(model, each.motion), distance) for each in filtered]
    if sum(np.count_nonzero(rows) for rows in chosen) < limits.SLIDING_SAMPLES:
        raise NotPossible(
            "the rod never slides freely between its stops; record motion through the middle of its travel"
        )
    blocks, names = [], list(_columns(filtered[0], spring, stribeck_velocity))
    for each, rows in zip(filtered, chosen, strict=True):
        columns = _columns(each, spring, stribeck_velocity)
        doubt = each.motion.constant_error(float(model.diaphragm.stiffness))
        matrix = np.stack([column[rows] for column in columns.values()], axis=1)
        blocks.append(TraceEquations(matrix, each.force[rows], each.motion.time[rows], each.width, doubt))
    found = regress_traces([block for block in blocks if len(block.right)])

    def rows_of(name: str) -> Samples:
        return np.concatenate([getattr(each, name)[rows] for each, rows in zip(filtered, chosen, strict=True)])

    return Sliding(
        dict(zip(names, found.values.tolist(), strict=True)),
        dict(zip(names, found.std_errors.tolist(), strict=True)),
        rows_of("force"),
        rows_of("position"),
        rows_of("velocity"),
        rows_of("acceleration"),
    )


def _columns(filtered: Filtered, spring: bool, stribeck_velocity: float | None) -> dict[str, Samples]:
    """What the unknowns of the law multiply."""
    columns = {"preload": np.ones(len(filtered.force))}
    if spring:
        columns["stiffness"] = filtered.position
    columns["coulomb"] = filtered.direction
    if stribeck_velocity is not None:
        columns["drop"] = filtered.direction * np.exp(-np.abs(filtered.velocity) / stribeck_velocity)
    return columns | {"viscous": filtered.velocity, "mass": filtered.acceleration}


def _one_way(filtered: Filtered, inside: Bool[np.ndarray, " time"], distance: float) -> Bool[np.ndarray, " time"]:
    """Where a rod has slid one way for longer than a kernel.

    **Arguments:** `inside`: away from stops; `distance` in m after which friction has forgotten the last turn.
    """
    direction = filtered.direction
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    begin = np.zeros(len(direction), dtype=int)
    begin[turns] = turns
    since = np.abs(filtered.position - filtered.position[np.maximum.accumulate(begin)])
    slid = (direction != 0) & (since > distance) & inside & filtered.valid
    return scipy.ndimage.minimum_filter1d(slid, filtered.width, mode="constant", cval=0).astype(bool)


def at_closed_stop(
    motion: MotionRecord, preload: float, stiffness: float, friction: float
) -> Bool[np.ndarray, " time"]:
    """Samples at rest in the farther half of the motion whose drive friction and spring can't balance (N, N/m, N)."""
    filtered = filter_motion(motion, KERNEL)
    excess = filtered.force - preload - stiffness * filtered.position
    middle = 0.5 * (np.max(motion.position) + np.min(motion.position))
    held = (filtered.direction == 0) & (excess > limits.HELD_FORCE * friction)
    return filtered.valid & held & (filtered.position > middle)
