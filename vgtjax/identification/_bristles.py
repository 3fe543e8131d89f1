"""Friction that depends on the path: a regression through every turn of the rod [3.2-3.12]."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool
from scipy import optimize
from scipy.ndimage import minimum_filter1d

from ..estimation import least_squares
from ..plants import MechanicalActuator
from . import _limits as limits
from ._filters import Samples
from ._motion import MotionRecord, plain_friction, remove_noise
from ._result import Coefficients, NotPossible
from ._weak_form import Filtered, TraceEquations, filter_motion, regress_traces, through_kernel, within_stops

KERNEL = 0.05
"""s; from 0.03 to 0.1 s simulated traces give the same bristles within 1 %."""
SCALES = np.geomspace(0.1, 10, 9)
"""Multiples of the model's deflection that a search for the best one begins with."""
ENDS = {"deflection": (1e-7, 1e-2), "ratio": (0.7, 5.0), "stribeck": (1e-5, 0.1)}
"""Deflection of a sliding bristle in m, static over Coulomb force, Stribeck velocity in m/s: far beyond any bearing."""
STEP = 1e-3
"""Relative step of finite differences; rounding is 1e-8 of it."""
USUAL_STIFFNESS = 4e4
"""N/m; where a search begins for friction that has no bristles."""


@dataclasses.dataclass(frozen=True, eq=False)
class Path:
    """One motion with what its friction needs: `position` in m and `velocity` in m/s without noise, which would count
    as path, and `rows`, those away from the stops for a whole kernel; arrays of shape `(time,)`."""

    filtered: Filtered
    position: Samples
    velocity: Samples
    rows: Bool[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, eq=False)
class Bristles(Coefficients):
    """What paths determine of the names `preload, stiffness, coulomb, viscous, mass, bristle_damping` and `deflection,
    ratio, stribeck`.

    For a picture, of the path with most turns: `position` in m, `measured` friction without its viscous part in N, and
    `law`, what the bristles make of the path, likewise."""

    position: Samples
    measured: Samples
    law: Samples
    samples: int


def bristle_force(position: Samples, limit: Samples, deflection: float) -> Samples:
    """Force of bristles along a path that begins relaxed, in units of the Coulomb force [3.5, 3.6].

    Over a piece of path without a turn, `z' = v - sigma |v| z / g` has a closed solution in which time plays no part.

    **Arguments:** `position` in m; `limit`: `g / F_c`; `deflection`: `F_c / sigma` in m.
    """
    moved = np.diff(position)
    between = 0.5 * (limit[1:] + limit[:-1])
    kept = np.exp(-np.abs(moved) / (deflection * between))
    gained = np.sign(moved) * between * (1 - kept)
    # A Python loop over plain numbers: 2 ms for 10 s of trace.
    steps = zip(kept.tolist(), gained.tolist(), strict=True)
    forces = itertools.accumulate(steps, lambda force, step: step[0] * force + step[1], initial=0.0)
    return np.fromiter(forces, dtype=float, count=len(position))


def read_paths(model: MechanicalActuator, motions: Sequence[MotionRecord]) -> list[Path]:
    """Paths of those motions that slide between the stops."""
    paths = []
    for motion in motions:
        filtered = filter_motion(motion, KERNEL)
        inside = within_stops(model, motion) & filtered.valid
        rows = minimum_filter1d(inside, filtered.width, mode="constant", cval=0).astype(bool)
        if motion.trace.f_drive is not None:
            # An axis that sticks moves less than its sensor sees, and then its friction is anything up to the limit.
            rows &= through_kernel(filtered, (filtered.direction == 0).astype(float)) < limits.STICKING
        if np.count_nonzero(rows) >= limits.TURNING_SAMPLES and np.any(filtered.direction[rows] != 0):
            position = remove_noise(motion.position, motion.noise)
            paths.append(Path(filtered, position, np.gradient(position, motion.time), rows))
    return paths


def fit_bristles(model: MechanicalActuator, paths: Sequence[Path], stribeck: bool) -> Bristles:
    """Least squares of the drive over position, velocity, acceleration and the force of bristles along the path.

    All but the deflection is linear, and solved for each trial of it; with `stribeck`, all but the ratio of static to
    Coulomb force and the Stribeck velocity as well. Bristles have damping where those of the model have.

    **Raises:** `NotPossible` without a path.
    """
    if not paths:
        raise NotPossible(
            "the rod never moves freely between its stops; record it turning round in the middle of its travel"
        )
    friction = plain_friction(model)
    usual = float(friction.coulomb_force) / float(getattr(friction, "bristle_stiffness", USUAL_STIFFNESS))
    shape = []
    if stribeck:
        shape = [float(friction.static_force / friction.coulomb_force), float(friction.stribeck_velocity)]
    law = _Law(model, paths, friction)
    ends = np.log(np.array(list(ENDS.values()))[: 1 + len(shape)]).T
    trials = [np.clip(np.log([usual * scale, *shape]), ends[0] + STEP, ends[1] - STEP) for scale in SCALES]
    best = min(trials, key=lambda trial: float(np.sum(law.residual(trial) ** 2)))
    return law.report(optimize.least_squares(law.residual, best, bounds=ends, diff_step=STEP).x)


class _Law:
    """The regression for given logarithms of the nonlinear unknowns, in the order of `ENDS`."""

    def __init__(self, model: MechanicalActuator, paths: Sequence[Path], friction: Any):
        self.stiffness = float(model.diaphragm.stiffness)
        self.paths = paths
        self.damped = hasattr(friction, "bristle_damping")
        self.exponent = getattr(friction, "stribeck_exponent", 1)
        self.right = np.concatenate([path.filtered.force[path.rows] for path in paths])

    def columns(self, path: Path, logs: np.ndarray) -> dict[str, Samples]:
        """What the linear unknowns multiply, through the kernel and at the rows."""
        filtered, shape = path.filtered, np.exp(logs)
        limit = np.ones(len(path.position))
        if len(shape) > 1:
            limit = 1 + (shape[1] - 1) * np.exp(-((np.abs(path.velocity) / shape[2]) ** self.exponent))
        force = bristle_force(path.position, limit, float(shape[0]))
        columns = {"preload": np.ones(len(force))}
        if self.stiffness > 0:
            columns["stiffness"] = filtered.position
        columns["coulomb"] = through_kernel(filtered, force)
        columns |= {"viscous": filtered.velocity, "mass": filtered.acceleration}
        if self.damped:
            columns["bristle_damping"] = through_kernel(filtered, np.gradient(shape[0] * force, filtered.motion.time))
        return {name: column[path.rows] for name, column in columns.items()}

    def solve(self, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values of the linear unknowns, and the matrix of their columns."""
        blocks = [np.stack(list(self.columns(path, logs).values()), axis=1) for path in self.paths]
        matrix = np.concatenate(blocks)
        return least_squares(matrix, self.right).values, matrix

    def residual(self, logs: np.ndarray) -> np.ndarray:
        """Force that the law leaves, in N."""
        values, matrix = self.solve(logs)
        return self.right - matrix @ values

    def report(self, logs: np.ndarray) -> Bristles:
        """Values and errors at the solution, where the nonlinear unknowns enter by their derivatives."""
        linear, matrix = self.solve(logs)
        steps = STEP * np.eye(len(logs))
        slopes = [(self.solve(logs + step)[1] - matrix) @ linear / STEP for step in steps]
        whole, first, blocks = np.column_stack([matrix, *slopes]), 0, []
        for path in self.paths:
            motion, count = path.filtered.motion, int(np.count_nonzero(path.rows))
            doubt, rows = motion.constant_error(self.stiffness), slice(first, first + count)
            time = motion.time[path.rows]
            blocks.append(TraceEquations(whole[rows], self.right[rows], time, path.filtered.width, doubt))
            first += count
        errors = regress_traces(blocks, robust=False).std_errors
        errors[len(linear) :] *= np.exp(logs)  # derivatives were by logarithms
        names = [*self.columns(self.paths[0], logs), *list(ENDS)[: len(logs)]]
        values = np.where(np.isfinite(errors), np.concatenate([linear, np.exp(logs)]), np.nan)
        found, doubts = (dict(zip(names, each.tolist(), strict=True)) for each in (values, errors))
        return Bristles(found, doubts, *self.picture(logs, linear), len(self.right))

    def picture(self, logs: np.ndarray, linear: np.ndarray) -> tuple[Samples, Samples, Samples]:
        """Position, measured friction and that of the bristles, of the path with most turns."""
        path = max(self.paths, key=lambda each: int(np.sum(np.diff(np.sign(each.velocity[each.rows])) != 0)))
        columns = self.columns(path, logs)
        terms = {name: value * columns[name] for name, value in zip(columns, linear, strict=True)}
        law = terms["coulomb"] + terms.get("bristle_damping", 0.0)
        measured = path.filtered.force[path.rows] - sum(terms.values()) + law
        return path.filtered.position[path.rows], measured, law
