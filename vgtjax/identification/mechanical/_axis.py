"""Any axis with friction that a measured force drives: mass, friction, spring and a constant force."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..._errors import SimulationError
from ...estimation import Progress, Task, least_squares, start_calibration
from ...parameters import replace_parameters
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._axis_regression import filter_clear, moving_rows, regress_axis
from ._mechanical_fit import candidates, fit_response
from ._motion import MotionRecord, mechanical_half, read_motion, read_motions, sliding_law


@bench_test(
    "axis",
    "2.34, 2.35",
    "Regression of the drive over acceleration, velocity, direction and position through a smooth kernel, then "
    "nonlinear least squares of the position that follows from the drive.",
)
def identify_axis(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Mass, friction, spring and constant force of an axis that a force drives, from force and position alone [2.34].

    The constant force is `diaphragm.preload` (N, against +x). An axis without stops has an infinite `diaphragm.travel`;
    without a spring, `diaphragm.stiffness` is zero and stays so.

    **Arguments:** `model`: with start values, which may be wrong by orders of magnitude; `traces`: with `x_d` in m of
    either sign, and `f_drive` in N or `p_act` in Pa.

    **Returns:** parameters of diaphragm and friction by name, of shape `()`.
    """
    half, motions = mechanical_half(model), read_motions(model, traces)
    start = regress_axis(half, motions, candidates(half))
    response = fit_response(replace_parameters(half, start), motions)
    return response.report(figures=(*_figures(response.model, motions), *response.figures()))


def better_start(task: Task) -> Progress | None:
    """Where a fit of the mechanical model had better begin than at its start values; `None` if nowhere.

    Start values stay those of the task; only the search begins at what [`regress_axis`][] finds, if that is better.

    **Raises:** `SimulationError` when neither start can be simulated.
    """
    if not isinstance(task.plant, MechanicalActuator):
        return None
    motions = read_motions(task.plant, [trace for trace in task.fit if trace.f_drive is not None])
    try:
        found = regress_axis(task.plant, motions, task.selection.entries) if motions else {}
    except NotPossible:
        return None
    if not found:
        return None
    stated = _progress(task, {})
    better = _progress(task, found)
    if better is None or (stated is not None and stated.cost <= better.cost):
        return None
    return dataclasses.replace(better, history=())


def _progress(task: Task, values: dict[str, float]) -> Progress | None:
    """The start of a fit at the task's values and others, inside the bounds; `None` if it can't be simulated."""
    transform = task.transform()
    moved = task.selection.pack(replace_parameters(task.model, values))
    coordinates = transform.clip(transform.to_coordinates(moved))
    try:
        return start_calibration(task, Progress(tuple(np.asarray(coordinates).tolist()))).minimiser.progress
    except SimulationError:
        return None


def moves_at_start(trace: Trace) -> tuple[float, float] | None:
    """Speed in m/s at the first sample of a trace that a force drives, and the time in s of its first standstill.

    A simulation begins at rest, whatever the trace does: what comes before the standstill is best cut off. `None` where
    the axis begins at rest as well.
    """
    if trace.f_drive is None or trace.x_d is None:
        return None
    motion = read_motion(MechanicalActuator(), trace)
    filtered = filter_clear(motion)
    speed, error = _first_speed(motion)
    if not np.any(filtered.valid) or speed < max(
        limits.MOVING * error, limits.REST_SPEED * float(np.max(np.abs(filtered.velocity[filtered.valid])))
    ):
        return None
    way = filtered.direction[filtered.valid]
    still = np.flatnonzero(way != way[0])
    begin = motion.time[filtered.valid][still[0]] if len(still) else motion.time[-1]
    return speed, float(begin)


def _first_speed(motion: MotionRecord) -> tuple[float, float]:
    """Speed in m/s at the first sample and its standard error, from a parabola through the first moments.

    A kernel would look at what a force has done by its middle.
    """
    count = int(max(round(limits.START_TIME / motion.interval), limits.START_SAMPLES))
    time, position = motion.time[:count] - motion.time[0], motion.position[:count]
    if len(time) < limits.START_SAMPLES:
        return 0.0, np.inf
    powers = np.stack([np.ones_like(time), time, time**2], axis=1)
    found = least_squares(powers, position)
    left = max(float(np.std(position - powers @ found.values)), motion.noise)
    return float(abs(found.values[1])), left * float(found.std_errors[1])


def _figures(model: MechanicalActuator, motions: Sequence[MotionRecord]) -> tuple[Curve, ...]:
    """Friction over velocity where the axis moves, with the fitted law of steady sliding."""
    velocities, forces = [], []
    for motion in motions:
        filtered = filter_clear(motion)
        chosen = np.flatnonzero(moving_rows(model, filtered) & (filtered.direction != 0))
        chosen = chosen[thinned(len(chosen) * len(motions))]
        applied = filtered.force - float(model.diaphragm.preload) - float(model.diaphragm.stiffness) * filtered.position
        velocities.append(filtered.velocity[chosen])
        forces.append((applied - float(model.diaphragm.mass) * filtered.acceleration)[chosen])
    velocity, force = np.concatenate(velocities), np.concatenate(forces)
    speed = np.linspace(np.min(velocity, initial=0.0), np.max(velocity, initial=0.0), 401)
    line = (speed, sliding_law(model, speed))
    return (Curve("velocity, m/s", "friction, N", (velocity, force), line, "friction over velocity"),)
