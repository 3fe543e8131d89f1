"""Preload, stiffness and travel from slow motion in both directions [2.36]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...estimation import least_squares
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._motion import MotionRecord, mechanical_half, read_motions
from ._sliding import Sliding, at_closed_stop, fit_sliding


@bench_test(
    "spring",
    "2.36",
    "Least squares of the drive over position, direction, velocity and acceleration where the rod slides between "
    "its stops; travel from where it rests at the closed one.",
)
def identify_spring(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Preload, stiffness and travel of the diaphragm from slow motion and from the closed stop [2.36].

    **Arguments:** `model`: its stop stiffness and friction are start values; `traces`: with `x_d` in m, and `p_act` in
    Pa or `f_drive` in N.

    **Returns:** `diaphragm.preload` in N, `diaphragm.stiffness` in N/m, `diaphragm.travel` in m, of shape `()`.
    """
    half, motions = mechanical_half(model), read_motions(model, traces)
    if float(half.diaphragm.stiffness) == 0:
        raise NotPossible("the model has no spring; start diaphragm.stiffness above zero")
    found = _slide(half, motions)
    doubt = limits.STOP_ERROR * _pressed(half, found.values["preload"]) if any(np.any(m.rest) for m in motions) else 0.0
    values, errors, limitations = _determined(found, doubt)
    if "diaphragm.stiffness" in values and np.isfinite(float(half.diaphragm.travel)):
        travel = _travel(half, motions, found)
        if travel is None:
            limitations.append("diaphragm.travel: the rod does not rest at its closed stop; record a step to full duty")
        else:
            values["diaphragm.travel"], errors["diaphragm.travel"] = map(np.asarray, travel)
    return Identified(
        values=values,
        std_errors=errors,
        limitations=tuple(limitations),
        figures=(_figure(found),),
        samples=len(found.force),
    )


def _slide(half: MechanicalActuator, motions: Sequence[MotionRecord]) -> Sliding:
    """The law of the sliding rod; what preload does to the position of rest is put right with the preload found."""
    found = fit_sliding(half, motions, _stribeck_velocity(half))
    before = _pressed(half, float(half.diaphragm.preload))
    for _ in range(2):
        if not np.isfinite(found.values["preload"] + found.values["stiffness"]):
            break
        shift = _pressed(half, found.values["preload"]) - before
        moved = [
            dataclasses.replace(motion, position=motion.position + shift * bool(np.any(motion.rest)))
            for motion in motions
        ]
        found = fit_sliding(half, moved, _stribeck_velocity(half))
    return found


def _stribeck_velocity(half: MechanicalActuator) -> float | None:
    friction = half.friction.dry()
    velocity = None if friction is None else friction.stribeck_velocity
    return None if velocity is None else float(velocity) or None  # zero is none


def _pressed(half: MechanicalActuator, preload: float) -> float:
    """Position in m at which the open stop holds a preload in N."""
    return -preload / float(half.diaphragm.stiffness + half.diaphragm.stop_stiffness)


def _determined(found: Sliding, doubt: float) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """Values and errors by name, and a sentence for what is not determined.

    **Arguments:** `doubt`: standard error in m of the place of rest, the same in all traces.
    """
    values: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    limitations = []
    for term, remedy in (
        ("preload", "the rod does not slide in both directions; record it moving out and back"),
        ("stiffness", "the rod does not slide far enough; record it moving over much of its travel"),
    ):
        value, error = found.values[term], found.std_errors[term]
        if term == "preload":
            error = float(np.hypot(error, found.values["stiffness"] * doubt))
        if np.isfinite(error) and error < limits.ERROR_SPRING * abs(value) and (term == "preload" or value > 0):
            values[f"diaphragm.{term}"], errors[f"diaphragm.{term}"] = np.asarray(value), np.asarray(error)
        else:
            limitations.append(f"diaphragm.{term}: {remedy}")
    return values, errors, limitations


def _travel(half: MechanicalActuator, motions: Sequence[MotionRecord], found: Sliding) -> tuple[float, float] | None:
    """Travel and its standard error in m, from samples at rest that the drive presses into the closed stop.

    Unknowns are the travel, the compliance of the stops, of which the model's is known to a tenth, and the place of
    rest in each trace.
    """
    preload, stiffness = found.values["preload"], found.values["stiffness"]
    friction, compliance = abs(found.values["coulomb"]), 1 / float(half.diaphragm.stop_stiffness)
    rows, right = [[0.0, 1 / (limits.STOP_ERROR * compliance), *[0.0] * len(motions)]], [1 / limits.STOP_ERROR]
    count = 0
    for number, motion in enumerate(motions):
        held = at_closed_stop(motion, preload, stiffness, friction)
        if not np.any(held):
            continue
        measured, resting = np.asarray(motion.trace.x_d), bool(np.any(motion.rest))
        rest = float(np.mean(measured[motion.rest])) if resting else 0.0
        error = motion.noise / np.sqrt(np.sum(motion.rest)) if resting else motion.position_error
        excess = motion.force[held] - preload - stiffness * motion.position[held] - 0.5 * friction
        own = np.zeros((int(held.sum()), 2 + len(motions)))
        own[:, 0], own[:, 1], own[:, 2 + number] = 1.0, excess + (preload if resting else 0.0), 1.0
        rows += list(own / motion.noise)
        right += list((measured[held] - rest) / motion.noise)
        rows.append(np.eye(2 + len(motions))[2 + number] / error)
        right.append(0.0)
        count += int(held.sum())
    if count < limits.HELD_SAMPLES:
        return None
    solution = least_squares(np.array(rows), np.array(right))
    # Which way friction points at a stop is not known.
    return float(solution.values[0]), float(np.hypot(solution.std_errors[0], 0.5 * friction * compliance))


def _figure(found: Sliding) -> Curve:
    """Drive without viscous force and inertia over position, with the spring between the two branches."""
    chosen = thinned(len(found.force))
    dry = found.force - found.value("viscous") * found.velocity - found.value("mass") * found.acceleration
    ends = np.array([np.min(found.position), np.max(found.position)])
    line = (1e3 * ends, found.value("preload") + found.value("stiffness") * ends)
    return Curve("position, mm", "drive, N", (1e3 * found.position[chosen], dry[chosen]), line, "spring and preload")
