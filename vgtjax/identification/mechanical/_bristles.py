"""Friction that depends on the path: a regression through every turn of the rod [3.2-3.12]."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Bool

from ...estimation import NULL, least_squares
from ...parts import DryFriction, LuGre
from ...plants import MechanicalActuator
from .. import _limits as limits
from .._filters import Samples
from .._result import Coefficients, NotPossible
from ._motion import MotionRecord, dry_friction
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
    # The recursion `force = kept force + gained` is a system of two bands, solved forwards.
    bands = np.stack([np.ones(len(position)), -np.append(kept, 0.0)])
    return scipy.linalg.solve_banded((1, 0), bands, np.append(0.0, gained), overwrite_ab=True)


def read_paths(model: MechanicalActuator, motions: Sequence[MotionRecord]) -> list[Path]:
    """Paths of those motions that slide between the stops."""
    paths = []
    for motion in motions:
        filtered = filter_motion(motion, KERNEL)
        inside = within_stops(model, motion) & filtered.valid
        rows = scipy.ndimage.minimum_filter1d(inside, filtered.width, mode="constant", cval=0).astype(bool)
        if motion.trace.f_drive is not None:
            # An axis that sticks moves less than its sensor sees, and then its friction is anything up to the limit.
            rows &= through_kernel(filtered, (filtered.direction == 0).astype(float)) < limits.STICKING
        if np.count_nonzero(rows) >= limits.TURNING_SAMPLES and np.any(filtered.direction[rows] != 0):
            position = motion.smooth_position
            paths.append(Path(filtered, position, np.gradient(position, motion.time), rows))
    return paths


def fit_bristles(model: MechanicalActuator, paths: Sequence[Path], stribeck: bool) -> Bristles:
    """Least squares of the drive over position, velocity, acceleration and the force of bristles along the path.

    All but the deflection is linear, and solved for each trial of it; with `stribeck`, all but the ratio of static to
    Coulomb force and the Stribeck velocity as well. Bristles have damping where those of the model have.

    **Raises:** `NotPossible` without a path, or for a law without a Coulomb force.
    """
    if not paths:
        raise NotPossible(
            "the rod never moves freely between its stops; record it turning round in the middle of its travel"
        )
    friction = dry_friction(model)
    stiffness = USUAL_STIFFNESS if friction.bristle_stiffness is None else float(friction.bristle_stiffness)
    usual = float(friction.coulomb_force or LuGre().coulomb_force) / stiffness
    shape = []
    if stribeck:
        assert friction.stribeck_velocity is not None
        shape = [float(friction.stiction), float(friction.stribeck_velocity or LuGre().stribeck_velocity)]
    law = _Law(model, paths, friction)
    ends = np.log(np.array(list(ENDS.values()))[: 1 + len(shape)]).T
    trials = [np.clip(np.log([usual * scale, *shape]), ends[0] + STEP, ends[1] - STEP) for scale in SCALES]
    best = min(trials, key=lambda trial: float(np.sum(law.residual(trial) ** 2)))
    return law.report(scipy.optimize.least_squares(law.residual, best, bounds=ends, diff_step=STEP).x)


Columns = dict[str, np.ndarray]
"""What the linear unknowns multiply, by name, at all samples of a path."""


class _Law:
    """The regression for given logarithms of the nonlinear unknowns, in the order of `ENDS`."""

    def __init__(self, model: MechanicalActuator, paths: Sequence[Path], friction: DryFriction):
        self.paths = paths
        self.damped = friction.bristle_damping is not None
        self.exponent = friction.stribeck_exponent
        self.stiffness = float(model.diaphragm.stiffness)
        self.right = np.concatenate([path.filtered.force[path.rows] for path in paths])
        self.steady = [self.steady_columns(path.filtered) for path in paths]
        # What no trial changes is projected out once, so that a trial is left with one or two columns.
        matrix = self.stack(self.steady)
        self.span = scipy.linalg.orth(matrix / _lengths(matrix), rcond=NULL)
        self.target = self.right - self.span @ (self.span.T @ self.right)

    def steady_columns(self, filtered: Filtered) -> Columns:
        """What those linear unknowns multiply that bristles don't concern."""
        columns: Columns = {"preload": np.ones(len(filtered.force))}
        if self.stiffness > 0:
            columns["stiffness"] = filtered.position
        return columns | {"viscous": filtered.velocity, "mass": filtered.acceleration}

    def bristle_columns(self, path: Path, logs: np.ndarray) -> Columns:
        """What the linear unknowns of the bristles multiply, through the kernel."""
        filtered, shape = path.filtered, np.exp(logs)
        limit = np.ones(len(path.position))
        if len(shape) > 1:
            limit = 1 + (shape[1] - 1) * np.exp(-((np.abs(path.velocity) / shape[2]) ** self.exponent))
        force = bristle_force(path.position, limit, float(shape[0]))
        columns = {"coulomb": through_kernel(filtered, force)}
        if self.damped:
            columns["bristle_damping"] = through_kernel(filtered, np.gradient(shape[0] * force, filtered.motion.time))
        return columns

    def columns(self, logs: np.ndarray) -> list[Columns]:
        """What the linear unknowns multiply, of every path."""
        bristles = [self.bristle_columns(path, logs) for path in self.paths]
        return [steady | own for steady, own in zip(self.steady, bristles, strict=True)]

    def stack(self, columns: Sequence[Columns]) -> np.ndarray:
        """A matrix of the columns of all paths at their rows."""
        blocks = [np.stack(list(each.values()), axis=1) for each in columns]
        return np.concatenate([block[path.rows] for block, path in zip(blocks, self.paths, strict=True)])

    def residual(self, logs: np.ndarray) -> np.ndarray:
        """Force that the law leaves, in N."""
        matrix = self.stack([self.bristle_columns(path, logs) for path in self.paths])
        left = (matrix - self.span @ (self.span.T @ matrix)) / _lengths(matrix)
        return self.target - left @ scipy.linalg.lstsq(left, self.target, cond=NULL)[0]

    def report(self, logs: np.ndarray) -> Bristles:
        """Values and errors at the solution, where the nonlinear unknowns enter by their derivatives."""
        columns = self.columns(logs)
        matrix = self.stack(columns)
        linear = least_squares(matrix, self.right).values
        steps = STEP * np.eye(len(logs))
        slopes = [(self.stack(self.columns(logs + step)) - matrix) @ linear / STEP for step in steps]
        whole, first, blocks = np.column_stack([matrix, *slopes]), 0, []
        for path in self.paths:
            motion, count = path.filtered.motion, int(np.count_nonzero(path.rows))
            doubt, rows = motion.constant_error(self.stiffness), slice(first, first + count)
            time = motion.time[path.rows]
            blocks.append(TraceEquations(whole[rows], self.right[rows], time, path.filtered.width, doubt))
            first += count
        errors = regress_traces(blocks, robust=False).std_errors
        errors[len(linear) :] *= np.exp(logs)  # derivatives were by logarithms
        names = [*columns[0], *list(ENDS)[: len(logs)]]
        values = np.where(np.isfinite(errors), np.concatenate([linear, np.exp(logs)]), np.nan)
        found, doubts = (dict(zip(names, each.tolist(), strict=True)) for each in (values, errors))
        return Bristles(found, doubts, *self.picture(columns, linear), len(self.right))

    def picture(self, columns: Sequence[Columns], linear: np.ndarray) -> tuple[Samples, Samples, Samples]:
        """Position, measured friction and that of the bristles, of the path with most turns."""
        turns = [int(np.sum(np.diff(np.sign(path.velocity[path.rows])) != 0)) for path in self.paths]
        most = int(np.argmax(turns))
        path, own = self.paths[most], columns[most]
        terms = {name: value * own[name][path.rows] for name, value in zip(own, linear, strict=True)}
        law = terms["coulomb"] + terms.get("bristle_damping", 0.0)
        measured = path.filtered.force[path.rows] - sum(terms.values()) + law
        return path.filtered.position[path.rows], measured, law


def _lengths(columns: np.ndarray) -> np.ndarray:
    """Of columns, and one for those that are zero."""
    lengths = np.linalg.norm(columns, axis=0)
    return np.where(lengths > 0, lengths, 1.0)
