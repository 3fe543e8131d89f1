"""LuGre friction from sliding, break-away and turns [3.8-3.12]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..parameters import parameter_table, replace_parameters
from ..plants import AbstractModel, MechanicalActuator
from ..traces import Trace
from ._bristles import Bristles, fit_bristles, read_paths
from ._dahl import friction_over_position
from ._mechanical_fit import Response, fit_response
from ._motion import Motion, mechanical_half, plain_friction, read_motions
from ._result import Curve, Identified
from ._second_order import start_from_motion
from ._weak_form import Sliding, fit_sliding

VAGUE = 0.5
"""Relative standard error up to which a regression is a better start than what the model has."""
PLOTTED = 1500
"""Points a curve."""


def identify_lugre(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """All parameters of LuGre friction [3.8-3.12].

    First, where the rod slides, `F_act - F_sm = F_c sign(v) + sigma_2 v` [3.12], with the Stribeck term of [3.11].
    Then along the whole path, turns and break-away included: `F_s`, `v_s` [3.11], `sigma_0` and `sigma_1` by
    nonlinear least squares of the force. Last, from there, by nonlinear least squares of the simulated position, in
    which mass, spring and preload are unknowns as well, so that their errors are in those of friction.

    **Arguments:** `model`: with start values; `traces`: with `x_d` in m, and `p_act` in Pa or `f_drive` in N.

    **Returns:** every `friction` parameter that the traces tell, of shape `()`; those that they don't, for instance
    `sigma_1` from slow loops, are in `unseen`.
    """
    result = Identified(
        "LuGre friction",
        "3.8-3.12",
        "Regression of friction over velocity where the rod slides, then over its path, then nonlinear least squares "
        "of the position that follows from the drive.",
    )
    half, motions = mechanical_half(model), read_motions(model, traces)
    if not hasattr(plain_friction(half), "stribeck_velocity"):
        return dataclasses.replace(result, unseen=("the model's friction is not LuGre's; choose friction = 'lugre'",))
    bristles = fit_bristles(half, read_paths(half, motions), stribeck=True)
    start = start_from_bristles(start_from_motion(half, motions), bristles)
    response = fit_response(half, motions, start)
    if isinstance(response, str):
        return dataclasses.replace(result, unseen=(response,))
    mine = [name for name in response.values if name.startswith("friction.")]
    return dataclasses.replace(
        result,
        values={name: response.values[name] for name in mine},
        std_errors={name: response.std_errors[name] for name in mine},
        unseen=tuple(sentence for sentence in response.unseen if sentence.startswith("friction.")),
        figures=_figures(response, motions, bristles),
        samples=response.calibration.count,
    )


def start_from_bristles(half: MechanicalActuator, found: Bristles | str) -> MechanicalActuator:
    """`half` with what the paths tell of its friction."""
    if isinstance(found, str):
        return half

    def told(*names: str) -> bool:
        return all(found.relative_error(name) < VAGUE and found.values[name] > 0 for name in names)

    old, new = plain_friction(half), dict[str, float]()
    coulomb = float(old.coulomb_force)
    if told("coulomb"):
        new["coulomb_force"] = coulomb = found.values["coulomb"]
        new["static_force"] = coulomb * float(old.static_force / old.coulomb_force)
    if told("coulomb", "deflection"):
        new["bristle_stiffness"] = coulomb / found.values["deflection"]
    if told("ratio", "stribeck"):
        new["static_force"] = coulomb * found.values["ratio"]
        new["stribeck_velocity"] = found.values["stribeck"]
    for name, term in (("bristle_damping", "bristle_damping"), ("viscous_damping", "viscous")):
        if told(term):
            new[name] = found.values[term]
    if half.friction is not old:  # in parameters of its own
        damping = new.get("bristle_damping", float(old.bristle_damping))
        drop = max(new.get("static_force", float(old.static_force)) - coulomb, 0.0)
        new["stribeck_drop"] = drop
        viscous = new.get("viscous_damping", float(old.viscous_damping))
        new["excess_damping"] = max(viscous - damping * drop / coulomb, 0.0)
    table = parameter_table(half)
    named = {f"friction.{name}": value for name, value in new.items()}
    return replace_parameters(half, {name: value for name, value in named.items() if name in table})


def _figures(response: Response, motions: Sequence[Motion], bristles: Bristles | str) -> tuple[Curve, ...]:
    fitted: Any = plain_friction(response.model)
    figures = []
    sliding = fit_sliding(response.model, motions, float(fitted.stribeck_velocity))
    if isinstance(sliding, Sliding):
        chosen = slice(None, None, max(1, len(sliding.force) // PLOTTED))
        speed = np.linspace(np.min(sliding.velocity), np.max(sliding.velocity), 401)
        steady, static = float(fitted.coulomb_force), float(fitted.static_force)
        fading = (np.abs(speed) / float(fitted.stribeck_velocity)) ** getattr(fitted, "stribeck_exponent", 1)
        law = np.sign(speed) * (steady + (static - steady) * np.exp(-fading)) + float(fitted.viscous_damping) * speed
        figures.append(
            Curve(
                "velocity, mm/s",
                "friction, N",
                (1e3 * sliding.velocity[chosen], sliding.friction()[chosen]),
                (1e3 * speed, law),
                "friction over velocity",
            )
        )
    if isinstance(bristles, Bristles):
        figures.append(friction_over_position(bristles))
    return tuple(figures)
