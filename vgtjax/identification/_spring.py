"""Preload, stiffness and travel from slow motion in both directions [2.36]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..plants import AbstractModel, MechanicalActuator
from ..traces import Trace
from ._motion import Motion, mechanical_half, read_motions
from ._result import Curve, Identified
from ._weak_form import FEWEST_HELD, Sliding, at_closed_stop, fit_sliding

VAGUE = 0.5
"""Relative standard error above which a value is not worth having."""
STOP_DOUBT = 0.1
"""Part of the stop's stiffness by which the assumed one may be wrong: it says how far preload presses the rod in."""
PLOTTED = 1500
"""Points a curve."""


def identify_spring(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Preload, stiffness and travel of the diaphragm from slow motion and from the closed stop [2.36].

    Where the rod slides, `(p_atm - p_act) A_d = F_0 + k_sm x_d + friction` [2.36]. Friction takes the sign of the
    velocity and drops out between both directions; its viscous part and inertia, small in slow motion, are further
    unknowns. The sensors' offsets are those of the rest at zero duty; a trace without one tells the stiffness only.
    Samples near the stops are left out. Those at the closed one tell the travel: there, the rod sits deeper than
    `travel` by the excess of the force over the stop's stiffness, and at rest beyond zero in the same way.

    **Arguments:** `model`: its stop stiffness and friction are start values; `traces`: with `x_d` in m, and `p_act` in
    Pa or `f_drive` in N.

    **Returns:** `diaphragm.preload` in N, `diaphragm.stiffness` in N/m, `diaphragm.travel` in m, of shape `()`.
    """
    result = Identified(
        "spring",
        "2.36",
        "Least squares of the drive over position, direction, velocity and acceleration where the rod slides between "
        "its stops; travel from where it rests at the closed one.",
    )
    half, motions = mechanical_half(model), read_motions(model, traces)
    if float(half.diaphragm.stiffness) == 0:
        return dataclasses.replace(result, unseen=("the model has no spring; start diaphragm.stiffness above zero",))
    found = _slide(half, motions)
    if isinstance(found, str):
        return dataclasses.replace(result, unseen=(found,))
    doubt = STOP_DOUBT * _pressed(half, found.values["preload"]) if any(np.any(m.rest) for m in motions) else 0.0
    values, errors, unseen = _told(found, doubt)
    if "diaphragm.stiffness" in values and np.isfinite(float(half.diaphragm.travel)):
        travel = _travel(half, motions, found)
        if travel is None:
            unseen.append("diaphragm.travel: the rod does not rest at its closed stop; record a step to full duty")
        else:
            values["diaphragm.travel"], errors["diaphragm.travel"] = map(np.asarray, travel)
    return dataclasses.replace(
        result,
        values=values,
        std_errors=errors,
        unseen=tuple(unseen),
        figures=_figures(found),
        samples=len(found.force),
    )


def _slide(half: MechanicalActuator, motions: Sequence[Motion]) -> Sliding | str:
    """The law of the sliding rod; what preload does to the position of rest is put right with the preload found."""
    found = fit_sliding(half, motions, float(getattr(half.friction, "stribeck_velocity", 0.0)) or None)
    before = _pressed(half, float(half.diaphragm.preload))
    for _ in range(2):
        if isinstance(found, str) or not np.isfinite(found.values["preload"] + found.values["stiffness"]):
            break
        shift = _pressed(half, found.values["preload"]) - before
        moved = [
            dataclasses.replace(motion, position=motion.position + shift * bool(np.any(motion.rest)))
            for motion in motions
        ]
        found = fit_sliding(half, moved, float(getattr(half.friction, "stribeck_velocity", 0.0)) or None)
    return found


def _pressed(half: MechanicalActuator, preload: float) -> float:
    """Position in m at which the open stop holds a preload in N."""
    return -preload / float(half.diaphragm.stiffness + half.diaphragm.stop_stiffness)


def _told(found: Sliding, doubt: float) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """Values and errors by name, and a sentence for what is not told.

    **Arguments:** `doubt`: standard error in m of the place of rest, the same in all traces.
    """
    values: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    unseen = []
    for term, remedy in (
        ("preload", "the rod does not slide in both directions; record it moving out and back"),
        ("stiffness", "the rod does not slide far enough; record it moving over much of its travel"),
    ):
        value, error = found.values[term], found.std_errors[term]
        if term == "preload":
            error = float(np.hypot(error, found.values["stiffness"] * doubt))
        if np.isfinite(error) and error < VAGUE * abs(value) and (term == "preload" or value > 0):
            values[f"diaphragm.{term}"], errors[f"diaphragm.{term}"] = np.asarray(value), np.asarray(error)
        else:
            unseen.append(f"diaphragm.{term}: {remedy}")
    return values, errors, unseen


def _travel(half: MechanicalActuator, motions: Sequence[Motion], found: Sliding) -> tuple[float, float] | None:
    """Travel and its standard error in m, from samples at rest that the drive presses into the closed stop.

    Unknowns are the travel, the compliance of the stops, of which the model's is known to a tenth, and the place of
    rest in each trace.
    """
    preload, stiffness = found.values["preload"], found.values["stiffness"]
    friction, compliance = abs(found.values["coulomb"]), 1 / float(half.diaphragm.stop_stiffness)
    rows, right = [[0.0, 1 / (STOP_DOUBT * compliance), *[0.0] * len(motions)]], [1 / STOP_DOUBT]
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
    if count < FEWEST_HELD:
        return None
    matrix = np.array(rows)
    solution = np.linalg.lstsq(matrix, np.array(right), rcond=None)[0]
    variance = np.linalg.pinv(matrix.T @ matrix)[0, 0]
    # Which way friction points at a stop is not known.
    return float(solution[0]), float(np.sqrt(variance + (0.5 * friction * compliance) ** 2))


def _figures(found: Sliding) -> tuple[Curve, ...]:
    """Drive without viscous force and inertia over position, with the spring between the two branches."""
    kept = {name: 0.0 if np.isnan(value) else value for name, value in found.values.items()}
    chosen = slice(None, None, max(1, len(found.force) // PLOTTED))
    dry = found.force - kept["viscous"] * found.velocity - kept["mass"] * found.acceleration
    ends = np.array([np.min(found.position), np.max(found.position)])
    return (
        Curve(
            "position, mm",
            "drive, N",
            (1e3 * found.position[chosen], dry[chosen]),
            (1e3 * ends, kept["preload"] + kept["stiffness"] * ends),
            "spring and preload",
        ),
    )
