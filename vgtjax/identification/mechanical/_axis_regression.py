"""Regression of the force on an axis that turns round: mass, friction, spring and constant force as start values."""

from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Bool

from ...parameters import Parameter, get_parameter, parameter_table
from ...plants import MechanicalActuator
from .. import _limits as limits
from .._result import NotPossible
from ._motion import MotionRecord
from ._weak_form import Filtered, TraceEquations, filter_motion, regress_traces, through_kernel, within_stops

KERNELS = (0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""s; the shortest through which noise does not hide the acceleration is taken: longer ones blur the turns."""
HIDDEN = 1e-3
"""Part of the acceleration's variance that noise may make; it lowers the mass by as much."""
TERMS = {
    "diaphragm.preload": "constant",
    "diaphragm.stiffness": "position",
    "friction.coulomb_force": "direction",
    "friction.viscous_damping": "velocity",
    "diaphragm.mass": "acceleration",
}
"""What each parameter multiplies in the force."""


def regress_axis(model: MechanicalActuator, motions: Sequence[MotionRecord], free: Collection[str]) -> dict[str, float]:
    """Start values, in the units of the table, for those of the free parameters that a regression determines [2.34].

    Parameters that are not free count with the model's value. Static force, bristles and their damping follow the
    Coulomb force and mass in proportion.

    **Raises:** `NotPossible` when no trace shows enough motion.
    """
    filtered = [filter_clear(motion) for motion in motions]
    rows = [moving_rows(model, each) for each in filtered]
    if sum(np.count_nonzero(chosen) for chosen in rows) < limits.TURNING_SAMPLES:
        raise NotPossible(
            "no trace shows the axis move for long under a measured drive; record motion in both directions"
        )
    table = parameter_table(model)
    known = {name: _value(model, name) for name in TERMS if name in table and name not in free}
    unknown = [name for name in TERMS if name not in known]
    if not set(TERMS) & set(free):
        return {}
    blocks = []
    for each, chosen in zip(filtered, rows, strict=True):
        columns = _columns(each)
        right = each.force - sum(value * columns[TERMS[name]] for name, value in known.items())
        right = right - _value(model, "diaphragm.damping") * each.velocity
        matrix = np.stack([columns[TERMS[name]][chosen] for name in unknown], axis=1)
        if len(matrix):
            blocks.append(
                TraceEquations(matrix, right[chosen], each.motion.time[chosen], each.width, each.motion.force_error)
            )
    found = regress_traces(blocks)
    values = {
        name: float(value)
        for name, value, error in zip(unknown, found.values, found.std_errors, strict=True)
        if np.isfinite(error) and (not _positive(table, name) or (value > 0 and error < limits.ERROR * value))
    }
    return _in_proportion(model, values, free)


def _value(model: MechanicalActuator, name: str) -> float:
    return float(get_parameter(model, name))


def _positive(table: dict[str, Parameter], name: str) -> bool:
    return name not in table or table[name].positive


def filter_clear(motion: MotionRecord) -> Filtered:
    """Through the shortest kernel whose acceleration is clear of noise."""
    filtered = filter_motion(motion, KERNELS[0])
    for seconds in KERNELS:
        filtered = filter_motion(motion, seconds)
        if not np.any(filtered.valid):  # the trace is shorter than that
            break
        if filtered.acceleration_noise**2 < HIDDEN * np.var(filtered.acceleration[filtered.valid]):
            break
    return filtered


def moving_rows(model: MechanicalActuator, filtered: Filtered) -> Bool[np.ndarray, " time"]:
    """Where the axis moves for nearly all of a kernel, away from its stops; it may turn round."""
    apart = through_kernel(filtered, ((filtered.direction == 0) | ~within_stops(model, filtered.motion)).astype(float))
    return filtered.valid & (apart < limits.STICKING)


def _columns(filtered: Filtered) -> dict[str, np.ndarray]:
    """The terms of the force, through one kernel."""
    return {
        "constant": np.ones(len(filtered.force)),
        "position": filtered.position,
        "direction": through_kernel(filtered, np.sign(filtered.velocity)),
        "velocity": filtered.velocity,
        "acceleration": filtered.acceleration,
    }


def _in_proportion(model: MechanicalActuator, values: dict[str, float], free: Collection[str]) -> dict[str, float]:
    """Values that are free, with what friction has besides: sized like the Coulomb force and the mass found."""
    friction = model.friction.dry()
    if friction is None:
        return {name: value for name, value in values.items() if name in free}
    old = float(friction.coulomb_force)
    larger = values.get("friction.coulomb_force", old) / old if old > 0 else 1.0
    heavier = values.get("diaphragm.mass", _value(model, "diaphragm.mass")) / _value(model, "diaphragm.mass")
    grown = {"static_force": larger, "stribeck_drop": larger, "bristle_stiffness": larger}
    grown["bristle_damping"] = np.sqrt(larger * heavier)  # so that bristles stay as well damped as they were
    for name, factor in grown.items():
        if f"friction.{name}" in free:
            values[f"friction.{name}"] = _value(model, f"friction.{name}") * factor
    damping = friction.bristle_damping
    if damping is not None and "friction.excess_damping" in free and "friction.viscous_damping" in values:
        least = float(damping * (friction.stiction - 1))
        values["friction.excess_damping"] = max(
            values["friction.viscous_damping"] - least * float(grown["bristle_damping"]), 0.0
        )
    return {name: value for name, value in values.items() if name in free}
