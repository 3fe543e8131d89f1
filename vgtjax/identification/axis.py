"""Any axis with friction that a measured force drives: mass, friction, spring and a constant force."""

import dataclasses
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

from ..errors import SimulationError
from ..estimation import Progress, Task, start_calibration
from ..mechanical import MechanicalActuator
from ..model import AbstractModel
from ..parameters import Parameter, get_parameter, parameter_table, replace_parameters
from ..trace import Trace
from ..transforms import build_transform
from .mechanical_fit import candidates, fit_response, response_figures
from .motion import Motion, mechanical_half, plain_friction, read_motion, read_motions
from .result import Curve, Identified
from .weak_form import Filtered, Rows, filter_motion, regress, through_kernel, within_stops

KERNELS = (0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""s; the shortest through which noise does not hide the acceleration is taken: longer ones blur the turns."""
HIDDEN = 1e-3
"""Part of the acceleration's variance that noise may make; it lowers the mass by as much."""
STUCK = 0.05
"""Part of a kernel over which the axis may be at rest, where friction has no known value."""
FEWEST = 50
"""Rows of the regression."""
PLOTTED = 1500
"""Points a curve."""
SLOW = 0.02
"""Part of the greatest speed that counts as rest at the first sample."""
VAGUE = 0.3
"""Relative standard error above which a value is no start."""
TERMS = {
    "diaphragm.preload": "constant",
    "diaphragm.stiffness": "position",
    "friction.coulomb_force": "direction",
    "friction.viscous_damping": "velocity",
    "diaphragm.mass": "acceleration",
}
"""What each parameter multiplies in the force."""


def identify_axis(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Mass, friction, spring and constant force of an axis that a force drives, from force and position alone [2.34].

    `f = m a + b v + F_c sign(v) + k x + F_0`, for instance of a linear motor: every term through the same smooth
    kernel, so that no signal is differentiated and noise does not bias the regression. It is the start of a nonlinear
    least squares of the simulated position, with the friction that the model has. The constant force is
    `diaphragm.preload` (N, against +x). An axis without stops has an infinite `diaphragm.travel`; without a spring,
    `diaphragm.stiffness` is zero and stays so.

    **Arguments:** `model`: with start values, which may be wrong by orders of magnitude; `traces`: with `x_d` in m of
    either sign, and `f_drive` in N or `p_act` in Pa.

    **Returns:** parameters of diaphragm and friction by name, of shape `()`.
    """
    result = Identified(
        "axis",
        "2.34, 2.35",
        "Regression of the drive over acceleration, velocity, direction and position through a smooth kernel, then "
        "nonlinear least squares of the position that follows from the drive.",
    )
    half, motions = mechanical_half(model), read_motions(model, traces)
    start = regress_axis(half, motions, candidates(half))
    if isinstance(start, str):
        return dataclasses.replace(result, unseen=(start,))
    response = fit_response(replace_parameters(half, start), motions)
    if isinstance(response, str):
        return dataclasses.replace(result, unseen=(response,))
    return dataclasses.replace(
        result,
        values=response.values,
        std_errors=response.std_errors,
        unseen=response.unseen,
        figures=(*_figures(response.model, motions), *response_figures(response)),
        samples=response.calibration.count,
    )


def regress_axis(model: MechanicalActuator, motions: Sequence[Motion], free: Collection[str]) -> dict[str, float] | str:
    """Start values for those of the free parameters that a regression tells, or why there are none.

    Parameters that are not free count with the model's value. Static force, bristles and their damping follow the
    Coulomb force and mass in proportion.
    """
    seen = [_filter(motion) for motion in motions]
    rows = [_moving(model, each) for each in seen]
    if sum(np.count_nonzero(chosen) for chosen in rows) < FEWEST:
        return "no trace shows the axis move for long under a measured drive; record motion in both directions"
    table = parameter_table(model)
    known = {name: _value(model, name) for name in TERMS if name in table and name not in free}
    unknown = [name for name in TERMS if name not in known]
    if not set(TERMS) & set(free):
        return {}
    blocks = []
    for each, chosen in zip(seen, rows, strict=True):
        columns = _columns(each)
        right = each.force - sum(value * columns[TERMS[name]] for name, value in known.items())
        right = right - _value(model, "diaphragm.damping") * each.velocity
        matrix = np.stack([columns[TERMS[name]][chosen] for name in unknown], axis=1)
        if len(matrix):
            blocks.append(Rows(matrix, right[chosen], each.motion.time[chosen], each.width, each.motion.force_error))
    found = regress(blocks)
    values = {
        name: float(value)
        for name, value, error in zip(unknown, found.values, found.std_errors, strict=True)
        if np.isfinite(error) and (not _positive(table, name) or (value > 0 and error < VAGUE * value))
    }
    return _in_proportion(model, values, free)


def _value(model: MechanicalActuator, name: str) -> float:
    return float(get_parameter(model, name))


def _positive(table: dict[str, Parameter], name: str) -> bool:
    return name not in table or table[name].positive


def _filter(motion: Motion) -> Filtered:
    """Through the shortest kernel whose acceleration is clear of noise."""
    seen = filter_motion(motion, KERNELS[0])
    for seconds in KERNELS:
        seen = filter_motion(motion, seconds)
        if not np.any(seen.valid):  # the trace is shorter than that
            break
        if seen.acceleration_noise**2 < HIDDEN * np.var(seen.acceleration[seen.valid]):
            break
    return seen


def _moving(model: MechanicalActuator, seen: Filtered) -> Bool[np.ndarray, " time"]:
    """Where the axis moves for nearly all of a kernel, away from its stops; it may turn round."""
    apart = through_kernel(seen, ((seen.direction == 0) | ~within_stops(model, seen.motion)).astype(float))
    return seen.valid & (apart < STUCK)


def _columns(seen: Filtered) -> dict[str, np.ndarray]:
    """The terms of the force, through one kernel."""
    return {
        "constant": np.ones(len(seen.force)),
        "position": seen.position,
        "direction": through_kernel(seen, np.sign(seen.velocity)),
        "velocity": seen.velocity,
        "acceleration": seen.acceleration,
    }


def _in_proportion(model: MechanicalActuator, values: dict[str, float], free: Collection[str]) -> dict[str, float]:
    """Values that are free, with what friction has besides: sized like the Coulomb force and the mass found."""
    friction = plain_friction(model)
    coulomb = values.get("friction.coulomb_force", float(friction.coulomb_force))
    larger = coulomb / float(friction.coulomb_force)
    heavier = values.get("diaphragm.mass", _value(model, "diaphragm.mass")) / _value(model, "diaphragm.mass")
    grown = {"static_force": larger, "stribeck_drop": larger, "bristle_stiffness": larger}
    grown["bristle_damping"] = np.sqrt(larger * heavier)  # so that bristles stay as well damped as they were
    for name, factor in grown.items():
        if f"friction.{name}" in free:
            values[f"friction.{name}"] = float(getattr(model.friction, name)) * factor
    if "friction.excess_damping" in free and "friction.viscous_damping" in values:
        least = float(friction.bristle_damping * (friction.static_force / friction.coulomb_force - 1))
        values["friction.excess_damping"] = max(
            values["friction.viscous_damping"] - least * float(grown["bristle_damping"]), 0.0
        )
    return {name: value for name, value in values.items() if name in free}


# -- a start for fits --------------------------------------------------------------------------------------------------


def better_start(task: Task) -> Progress | None:
    """Where a fit of the mechanical model had better begin than at its start values; `None` if nowhere.

    A position that drifts with every error of the force has no minimum that descent finds from afar: started at half
    the mass, a fit of a free axis ends nowhere. Start values stay those of the task; only the search begins at what
    [`regress_axis`][] finds, if that meets the traces better.

    **Raises:** `SimulationError` when neither start can be simulated.
    """
    if not isinstance(task.model, MechanicalActuator):
        return None
    motions = read_motions(task.model, [trace for trace in task.fit if trace.f_drive is not None])
    found = regress_axis(task.model, motions, task.selection.entries) if motions else {}
    if isinstance(found, str) or not found:
        return None
    stated = _progress(task, {})
    better = _progress(task, found)
    if better is None or (stated is not None and stated.cost <= better.cost):
        return None
    return dataclasses.replace(better, history=())


def _progress(task: Task, values: dict[str, float]) -> Progress | None:
    """The start of a fit at the task's values and others, inside the bounds; `None` if it can't be simulated."""
    start = np.asarray(task.selection.pack(task.model))
    transform = build_transform(parameter_table(task.model), task.selection.entries, start, task.bounds)
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
    seen = _filter(motion)
    way, speed = seen.direction[seen.valid], np.abs(seen.velocity[seen.valid])
    if len(way) == 0 or way[0] == 0 or speed[0] < SLOW * np.max(speed):
        return None
    still = np.flatnonzero(way != way[0])
    begin = motion.time[seen.valid][still[0]] if len(still) else motion.time[-1]
    return float(speed[0]), float(begin)


def _figures(model: MechanicalActuator, motions: Sequence[Motion]) -> tuple[Curve, ...]:
    """Friction over velocity where the axis moves, with the law of Coulomb and viscous friction."""
    friction: Any = plain_friction(model)
    if not hasattr(friction, "viscous_damping"):
        return ()
    velocities, forces = [], []
    for motion in motions:
        seen = _filter(motion)
        chosen = np.flatnonzero(_moving(model, seen) & (seen.direction != 0))
        chosen = chosen[:: max(1, len(chosen) * len(motions) // PLOTTED)]
        applied = seen.force - _value(model, "diaphragm.preload") - _value(model, "diaphragm.stiffness") * seen.position
        velocities.append(seen.velocity[chosen])
        forces.append((applied - _value(model, "diaphragm.mass") * seen.acceleration)[chosen])
    velocity, force = np.concatenate(velocities), np.concatenate(forces)
    speed = np.linspace(np.min(velocity, initial=0.0), np.max(velocity, initial=0.0), 401)
    law = float(friction.coulomb_force) * np.sign(speed) + float(friction.viscous_damping) * speed
    return (Curve("velocity, m/s", "friction, N", (velocity, force), (speed, law), "friction over velocity"),)
